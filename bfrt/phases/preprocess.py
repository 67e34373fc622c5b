"""The preprocess: mark the voxels where a box's region begins (the paper's section 2).

The paper marks every voxel that a bounding box overlaps. A ray needs to be stored only where it
*enters* the region of a box (its footnote 3), so ours is a mark for each face of a voxel, set
where a region begins at that face: marking costs the surface of a region, not its volume.

A grid that memory does not hold is preprocessed in subspaces, each in a pass over the hierarchy
that leaves out what lies outside it (section 3.2).
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from bfrt.geometry.lattice import Lattice
from bfrt.phases._preprocess import mark
from bfrt.phases._slabs import pack
from bfrt.phases.partition import Partition, subspaces
from bfrt.phases.selection import Parents, Selections, sweep_all, sweep_near
from bfrt.phases.subspace import Subspace
from bfrt.scene.marks import (
    BRICK,
    BRICK_BYTES,
    Layout,
    Marks,
    MarksWriter,
    Shape,
    bricks_of,
    marks_path,
    open_marks,
    writing_marks,
)
from bfrt.scene.objects import Objects
from bfrt.scene.store import Group, Store
from bfrt.scene.sweep import Sweep
from bfrt.stats import Counters

Bytes = NDArray[np.uint8]

#: A box grows by this part of the diagonal of the scene's bounds when rays meet it.
GROW = 2.0**-30

#: And by no less than this part of the greatest coordinate, 2^7 units in its last place: what hits
#: may be off by where a scene is more than 2^16 diagonals from the store's origin.
ROUNDED = 2.0**-46


def growth(store: Store) -> float:
    """DESIGN's d: the same for every grid and group of a scene."""
    return max(GROW * store.bounds.diagonal, ROUNDED * store.bounds.reach)


def lattice_of(store: Store, group: Group, shape: Shape, axis: int = 2) -> Lattice:
    """The grid of a group."""
    if group.grid_bounds.empty:
        return Lattice((0.0,) * 3, (1.0,) * 3, (1, 1, 1), 0.0)
    lo, hi = group.grid_bounds
    thick = (group.grid_bounds.grid_sides() - (hi - lo)) / 2
    # A scene of one point has no diagonal: give its voxel some room.
    room = 0.0 if store.bounds.diagonal else max(1.0, float(np.abs(lo).max()))
    return Lattice(lo - thick - room, hi + thick + room, shape, growth(store), axis)


def layout_of(group: Group, partition: Partition, hierarchy: bool) -> Layout:
    """What the marks of a group's grid are of: with the hierarchy, of quantised boxes."""
    return Layout(partition.shape, partition.axis, group.quantised_checksum if hierarchy else 0)


def preprocess(
    store: Store,
    objects: Objects,
    selections: Selections | None,
    lattice: Lattice,
    partition: Partition,
    subspace: int,
    *,
    fresh: bool,
    scratch: Path,
    counters: Counters,
) -> tuple[Marks, bool]:
    """The marks of a group's grid, and whether they were there already.

    Parameters
    ----------
    selections : Selections, optional
        Without, every subspace takes a pass over all objects, and marks are of their boxes as they
        are, whatever quantised ones there are.
    subspace : int
        Voxels that are marked at a time, at the most.

    Returns
    -------
    marks : Marks
    reused : bool
    """
    path = marks_path(store, objects.group, scratch)
    layout = layout_of(objects.group, partition, selections is not None)
    found = None if fresh else open_marks(path, store, layout)
    if found is not None:
        return found, True
    marking = Marking(objects, selections, lattice, counters)
    with writing_marks(path, store, layout) as writer:
        marking.mark_all(subspace, writer)
    counters.phases.preprocess.bytes_written += writer.bytes
    return writer.marks, False


class Marking:
    """Makes the marks of a grid, subspace by subspace."""

    def __init__(
        self,
        objects: Objects,
        selections: Selections | None,
        lattice: Lattice,
        counters: Counters,
    ) -> None:
        self._objects = objects
        self._selections = selections
        self._lattice = lattice
        self._counters = counters

    def mark_all(self, most: int, writer: MarksWriter) -> None:
        """Write all layers, of subspaces of up to `most` voxels."""
        for first, end in subspaces(self._lattice.layered, most):
            for bricks, occupied in layers_of(self._marked(first, end)):
                writer.add(bricks, occupied)

    def _marked(self, first: int, end: int) -> Bytes:
        """The marks of a subspace: one pass over the objects."""
        marks = np.zeros((end - first, *self._lattice.layered[1:]), np.uint8)
        subspace = Subspace(self._lattice, first, end)
        phase = self._counters.phases.preprocess

        def loop(_: int, sweep: Sweep, ranges: NDArray[np.int64], parents: Parents | None) -> None:
            mark(sweep, ranges, parents, self._lattice, subspace, marks)

        if self._selections is None:
            boxes = sweep_all(self._objects, loop)
        else:
            boxes = sweep_near(self._objects, self._selections, self._lattice, subspace, loop)
            boxes += self._selections.count(phase)
        self._counters.sweep(boxes, self._objects)
        phase.swept(self._objects)
        return marks


def layers_of(marks: Bytes) -> Iterator[tuple[Bytes, Bytes]]:
    """Layers of bricks of a subspace: those that are kept (n, 512), and which they are."""
    _, rows, row = bricks_of((1, marks.shape[1], marks.shape[2]))
    bricks = np.empty((rows * row, BRICK_BYTES), np.uint8)
    for first in range(0, len(marks), BRICK):
        occupied = np.empty((rows, row), np.uint8)
        n = pack(marks[first : first + BRICK], bricks, occupied)
        yield bricks[:n], occupied
