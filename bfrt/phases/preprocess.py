"""The preprocess: mark the voxels where a box's region begins (the paper's section 2).

The paper marks every voxel that a bounding box overlaps. A ray needs to be stored only where it
*enters* the region of a box (its footnote 3), so ours is a mark for each face of a voxel, set
where a region begins at that face: marking costs the surface of a region, not its volume.

A grid that memory does not hold is preprocessed in subspaces, each in a pass over the hierarchy
that leaves out what lies outside it (section 3.2).
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from bfrt.grid.bricks import BRICK, BRICK_BYTES, pack
from bfrt.grid.grid import Grid
from bfrt.grid.marks import MarksWriter
from bfrt.grid.marks_layout import Layout, Shape, bricks_of
from bfrt.grid.partition import Partition, subspaces
from bfrt.grid.selection import Selection
from bfrt.grid.subspace import Subspace
from bfrt.phases._preprocess import mark
from bfrt.scan.scans import GroupScans
from bfrt.scan.sources import Chunk
from bfrt.stats import Counters
from bfrt.store.store import Group, Store
from bfrt.workers import Workers

Bytes = NDArray[np.uint8]

#: A box is padded by this part of the diagonal of the scene's bounds when rays meet it.
PADDING = 2.0**-30

#: And by no less than this part of the greatest coordinate, 2^7 units in its last place: what hits
#: may be off by where a scene is more than 2^16 diagonals from the store's origin.
ROUNDED = 2.0**-46


def padding_of(store: Store) -> float:
    """Return d, by which boxes of a whole scene are padded (docs/algorithm.rst, Exactness)."""
    return max(PADDING * store.bounds.diagonal, ROUNDED * store.bounds.reach)


def grid_of(store: Store, group: Group, shape: Shape, axis: int = 2) -> Grid:
    """Make the grid of a group."""
    if group.grid_bounds.empty:
        return Grid((0.0,) * 3, (1.0,) * 3, (1, 1, 1), 0.0)
    lo, hi = group.grid_bounds
    thick = (group.grid_bounds.grid_sides() - (hi - lo)) / 2
    # A scene of one point has no diagonal: give its voxel some room.
    room = 0.0 if store.bounds.diagonal else max(1.0, float(np.abs(lo).max()))
    return Grid(lo - thick - room, hi + thick + room, shape, padding_of(store), axis)


def layout_of(group: Group, partition: Partition, hierarchy: bool) -> Layout:
    """Return the layout of a group's marks: of quantised boxes where the hierarchy is used."""
    return Layout(partition.shape, partition.axis, group.quantised_checksum if hierarchy else 0)


class Marking:
    """Makes the marks of a group's grid, subspace by subspace.

    Parameters
    ----------
    scans : GroupScans
    selection : Selection
        Without the hierarchy every subspace takes a pass over all objects, and marks are of their
        boxes as they are, whatever quantised ones there are.
    grid : Grid
        The grid.
    workers : Workers
    counters : Counters
    """

    def __init__(
        self,
        scans: GroupScans,
        selection: Selection,
        grid: Grid,
        workers: Workers,
        counters: Counters,
    ) -> None:
        self._scans = scans
        self._selection = selection
        self._grid = grid
        self._workers = workers
        self._counters = counters

    def mark_all(self, most: int, writer: MarksWriter) -> None:
        """Write all layers that are missing, of subspaces of up to `most` voxels."""
        for first, end in subspaces(self._grid.layered, most, writer.layers):
            for bricks, occupied in layers_of(self._marked(first, end)):
                writer.add(bricks, occupied)
        self._counters.phases.preprocess.bytes_written += writer.bytes

    def _marked(self, first: int, end: int) -> Bytes:
        """Mark a subspace: one pass over the objects."""
        marks = np.zeros((end - first, *self._grid.layered[1:]), np.uint8)
        subspace = Subspace(self._grid, first, end)
        phase = self._counters.phases.preprocess

        def meet(_: int, chunk: Chunk) -> None:
            mark(*chunk, self._grid, subspace, marks)

        swept = 0
        for stream in self._scans.streams:
            source = self._selection.near(stream, self._grid, subspace)
            self._workers.drain(source, meet)
            swept += source.swept
        self._counters.sweep(swept + self._selection.count(phase), self._scans)
        phase.swept(self._scans)
        return marks


def layers_of(marks: Bytes) -> Iterator[tuple[Bytes, Bytes]]:
    """Yield a subspace's layers of bricks: the bricks kept (n, 512), and which they are."""
    _, rows, row = bricks_of((1, marks.shape[1], marks.shape[2]))
    bricks = np.empty((rows * row, BRICK_BYTES), np.uint8)
    for first in range(0, len(marks), BRICK):
        occupied = np.empty((rows, row), np.uint8)
        n = pack(marks[first : first + BRICK], bricks, occupied)
        yield bricks[:n], occupied
