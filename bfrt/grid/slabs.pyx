"""Slabs: the layers of the grid that are in memory at a time (the paper's layered partition).

A slab is as many layers of bricks as memory holds, for empty bricks take none. It is read when a
ray waits in it. What is always there is where each brick is, so that a ray passes empty ones,
whatever slab they are in.
"""

cimport cython
from libc.stdint cimport int64_t

import numpy as np

from bfrt.grid.bricks cimport BRICK_BYTES, BRICK_SHIFT, EMPTY_BRICK, EMPTY_CUBE
from bfrt.grid.grid cimport Grid

#: Bricks along a side of the cubes that walks leave at once.
TOGETHER = 2

#: A brick: where it is, whether it is there, and its part of a cube.
TABLED_BYTES = 4 + 1 + 0.125 + 1


def table_of(occupied):
    """Return each brick's index among those that are kept; or `EMPTY_BRICK`, or `EMPTY_CUBE`."""
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


def cuts_of(bricks, capacity):
    """Return the first layer of each slab, and the end; `bricks` has the count of each layer."""
    cuts, first, held = [0], 0, 0
    for layer, n in enumerate(bricks.tolist()):
        if held + n > capacity and layer > first:
            first = layer
            cuts.append(first)
            held = 0
        held += n
    return [*cuts, len(bricks)]


@cython.final
cdef class Slabs:
    """Holds the marks of a grid, of which one slab is in memory.

    Parameters
    ----------
    grid : Grid
        The grid.
    marks : bfrt.grid.marks.Marks
        Its marks.
    room : int
        Bytes of a slab; one layer is taken even where it has more. The memory is taken here.
    workers : bfrt.workers.Workers

    Attributes
    ----------
    count : int
        Number of slabs.
    table : ndarray of int32, shape (layers, rows, bricks of a row)
        Where each brick is.
    slab_of : ndarray of int32, shape (layers,)
        The slab of each layer of bricks.
    """

    def __cinit__(self, Grid grid not None, marks, room, workers):
        cdef int64_t stride = 1
        cdef int k, axis
        self.grid = grid
        self.marks = marks
        self.workers = workers
        self.table = self.table_view = table_of(marks.occupied)
        self.firsts = self.cuts(marks, room)
        self.count = len(self.firsts) - 1
        self.slab_of = np.repeat(np.arange(self.count, dtype=np.int32), np.diff(self.firsts))
        self.layers = self.slab_of
        most = int(np.diff(marks.first[self.firsts]).max())
        self.memory = self.bricks = np.empty((max(1, most), BRICK_BYTES), np.uint8)
        self.slab.planes = &grid.planes
        self.slab.number = -1
        self.slab.axis = grid.planes.order[2]
        self.slab.table = &self.table_view[0, 0, 0]
        self.slab.slab_of = &self.layers[0]
        self.slab.bricks = &self.bricks[0, 0]
        for k in range(3):
            axis = grid.planes.order[k]
            self.slab.stride[axis] = stride
            self.slab.shift[axis] = k * BRICK_SHIFT
            stride *= self.table.shape[2 - k]

    @staticmethod
    def bytes(bricks, room):
        """Return the bytes of a slab and of the table of bricks, for a grid of `bricks` bricks.

        Parameters
        ----------
        room : int
            The most bytes of a slab.
        """
        return int(min(bricks * BRICK_BYTES, room) + bricks * TABLED_BYTES)

    @staticmethod
    def cuts(marks, room):
        """Return the layers of bricks at which slabs of `room` bytes begin, and how many there
        are."""
        return cuts_of(np.diff(marks.first), room // BRICK_BYTES)

    def load(self, int number):
        """Have a slab in memory.

        Raises
        ------
        StoreError
            If the marks are damaged.
        """
        if number == self.slab.number:
            return
        self.slab.number = -1
        first, last = self.firsts[number], self.firsts[number + 1]
        begin = int(self.marks.first[first])

        def layers(_, a, b):
            for layer in range(first + a, first + b):
                i, j = (int(n) - begin for n in self.marks.first[layer:layer + 2])
                self.marks.read(layer, self.memory[i:j])

        self.workers.run(layers, last - first)
        self.bytes_read += int(self.marks.at[last] - self.marks.at[first])
        self.slab.first_brick = begin
        self.slab.number = number

    def counts(self):
        """Count the bytes read since the last call."""
        read, self.bytes_read = self.bytes_read, 0
        return read

    def close(self):
        """Close the marks."""
        self.marks.close()
