"""Slabs: the layers of the grid that are in memory at a time (the paper's layered partition).

A slab is as many layers of bricks as memory holds, for empty bricks take none. It is read when a
ray waits in it. What is always there is where each brick is, so that a ray passes empty ones,
whatever slab they are in.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from bfrt.geometry.lattice import Lattice
from bfrt.store.marks import BRICK_BYTES, Marks
from bfrt.workers import Workers

#: Bricks along a side of the cubes that walks leave at once.
TOGETHER = 2

#: What the table has for a brick without marks, and for one in a cube without: as grid.pxd.
EMPTY_BRICK, EMPTY_CUBE = -1, -2

#: A brick: where it is, whether it is there, and its part of a cube.
TABLED_BYTES = 4 + 1 + 1 / 8 + 1


def table_of(occupied: NDArray[np.uint8]) -> NDArray[np.int32]:
    """Where each brick is among those that are kept; or `EMPTY_BRICK`, or `EMPTY_CUBE`."""
    table = np.cumsum(occupied.reshape(-1), dtype=np.int32).reshape(occupied.shape)
    table -= 1
    table[occupied == 0] = EMPTY_BRICK
    a, b, c = (-(-n // TOGETHER) for n in occupied.shape)
    cubes = np.zeros((a, b, c), np.uint8)
    for corner in np.ndindex(TOGETHER, TOGETHER, TOGETHER):
        i, j, k = (slice(first, None, TOGETHER) for first in corner)
        part = occupied[i, j, k]
        cubes[: part.shape[0], : part.shape[1], : part.shape[2]] |= part
    for corner in np.ndindex(TOGETHER, TOGETHER, TOGETHER):
        i, j, k = (slice(first, None, TOGETHER) for first in corner)
        own = table[i, j, k]
        own[cubes[: own.shape[0], : own.shape[1], : own.shape[2]] == 0] = EMPTY_CUBE
    return table


def cuts_of(bricks: NDArray[np.int64], capacity: int) -> list[int]:
    """The first layer of each slab, and the one beyond the last: layers have so many bricks."""
    cuts, held = [0], 0
    for layer, n in enumerate(bricks.tolist()):
        if held + n > capacity and layer > cuts[-1]:
            cuts.append(layer)
            held = 0
        held += n
    return [*cuts, len(bricks)]


class Slabs:
    """The marks of a grid, of which one slab is in memory.

    Parameters
    ----------
    lattice : Lattice
        The grid.
    marks : Marks
        Its marks.
    room : int
        Bytes of a slab; one layer is taken even where it has more. The memory is taken here.

    Attributes
    ----------
    count : int
        How many slabs there are.
    table : ndarray of int32, shape (layers, rows, bricks of a row)
        Where each brick is.
    slab_of : ndarray of int32, shape (layers,)
        The slab of each layer of bricks.
    """

    def __init__(self, lattice: Lattice, marks: Marks, room: int, workers: Workers) -> None:
        self.lattice = lattice
        self.table = table_of(marks.occupied)
        self.bytes_read = 0
        self._cuts = self.cuts(marks, room)
        self.count = len(self._cuts) - 1
        self.slab_of = np.repeat(np.arange(self.count, dtype=np.int32), np.diff(self._cuts))
        self._marks = marks
        self._workers = workers
        most = int(np.diff(marks.first[self._cuts]).max())
        self._bricks = np.empty((max(1, most), BRICK_BYTES), np.uint8)
        self._resident = -1

    @staticmethod
    def bytes(bricks: int, room: int) -> int:
        """Bytes of a slab of a grid of so many bricks, and of the table that tells where they are.

        Parameters
        ----------
        room : int
            Bytes of a slab at the most.
        """
        return int(min(bricks * BRICK_BYTES, room) + bricks * TABLED_BYTES)

    @staticmethod
    def cuts(marks: Marks, room: int) -> list[int]:
        """The layers of bricks at which slabs of `room` bytes begin, and how many there are."""
        return cuts_of(np.diff(marks.first), room // BRICK_BYTES)

    def load(self, slab: int) -> tuple[NDArray[np.uint8], int]:
        """The bricks of a slab, (n, 512), and the number of the first.

        Raises
        ------
        StoreError
            If the marks are damaged.
        """
        first, last = self._cuts[slab : slab + 2]
        begin = int(self._marks.first[first])
        if slab != self._resident:
            self._resident = -1

            def layers(_: int, a: int, b: int) -> None:
                for layer in range(first + a, first + b):
                    i, j = (int(n) - begin for n in self._marks.first[layer : layer + 2])
                    self._marks.read(layer, self._bricks[i:j])

            self._workers.run(layers, last - first)
            self.bytes_read += int(self._marks.at[last] - self._marks.at[first])
            self._resident = slab
        return self._bricks, begin

    def close(self) -> None:
        self._marks.close()
