"""The preprocess: mark the voxels where a box's region begins (the paper's section 2).

The paper marks every voxel that a bounding box overlaps. A ray needs to be stored only where it
*enters* the region of a box (its footnote 3), so ours is a mark for each face of a voxel, set
where a region begins at that face: marking costs the surface of a region, not its volume.
"""

from __future__ import annotations

import logging
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from bfrt.geometry.lattice import Lattice
from bfrt.phases._preprocess import darken, mark
from bfrt.scene.extent import Bounds
from bfrt.scene.marks import load_marks, marks_path, save_marks
from bfrt.scene.objects import Objects
from bfrt.scene.store import Group, Store
from bfrt.scene.sweep import Sweep
from bfrt.stats import Counters
from bfrt.workers import Workers

log = logging.getLogger(__name__)

#: Voxels for each object of the grid. One is the rule's; two measured better, with entry marks,
#: on rings of 8 thousand and of a million objects: fewer boxes to test, few more steps to walk.
VOXELS_EACH = 2

#: Voxels a side of the larger cubes that walks leave at once.
DARKER_CUBE = 16

#: A box grows by this part of the diagonal of the scene's bounds when rays meet it.
GROW = 2.0**-30


def growth(store: Store) -> float:
    """DESIGN's d: the same for every grid and group of a scene."""
    return GROW * store.bounds.diagonal


def resolution(bounds: Bounds, objects: int, most: int) -> tuple[int, int, int]:
    """Voxels an axis: cubic ones, in proportion to the objects, `most` of them at the most.

    The rule is Klimaszewski and Sederberg's (1997).
    """
    if bounds.empty or objects == 0:
        return (1, 1, 1)
    sides = bounds.grid_sides()
    if not sides.all():  # one point: any side will do
        return (1, 1, 1)
    voxels = float(max(1, min(VOXELS_EACH * objects, most)))
    while True:
        side = float(np.prod(sides / sides.max())) ** (1 / 3) * float(sides.max())
        side /= voxels ** (1 / 3)
        shape = np.maximum(1, np.rint(sides / side)).astype(np.int64)
        if int(np.prod(shape)) <= max(1, most):
            return (int(shape[0]), int(shape[1]), int(shape[2]))
        voxels *= 0.9


def lattice_of(store: Store, group: Group, shape: tuple[int, int, int]) -> Lattice:
    """The grid of a group."""
    if group.grid_bounds.empty:
        return Lattice((0.0,) * 3, (1.0,) * 3, (1, 1, 1), 0.0)
    lo, hi = group.grid_bounds
    thick = (group.grid_bounds.grid_sides() - (hi - lo)) / 2
    # A scene of one point has no diagonal: give its voxel some room.
    room = 0.0 if store.bounds.diagonal else max(1.0, float(np.abs(lo).max()))
    return Lattice(lo - thick - room, hi + thick + room, shape, growth(store))


def preprocess(
    store: Store,
    objects: Objects,
    lattice: Lattice,
    *,
    fresh: bool,
    scratch: Path,
    counters: Counters,
) -> tuple[NDArray[np.uint8], bool]:
    """The marks of a group's grid, and whether they were there already.

    Returns
    -------
    marks : (voxels,) uint8
        Bit f of a voxel is set where a region begins there by face f.
    reused : bool
    """
    path = marks_path(store, objects.group, scratch)
    marks = np.empty(lattice.voxels, np.uint8)
    if not fresh and load_marks(path, store, lattice.shape, marks):
        counters.phases.preprocess.bytes_read += marks.nbytes
        return marks, True
    marks[:] = 0

    def loop(_: int, sweep: Sweep, first: int, last: int) -> None:
        mark(sweep, last - first, lattice, marks)

    counters.sweep(objects.each(loop), objects)
    counters.phases.preprocess.swept(objects)
    try:
        counters.phases.preprocess.bytes_written += save_marks(path, store, lattice.shape, marks)
    except OSError as error:
        log.warning("marks are not kept for the next render: %s", error)
    return marks, False


def darken_all(marks: NDArray[np.uint8], lattice: Lattice, workers: Workers) -> None:
    """Add to each voxel's marks whether its cubes of 4 and of 16 voxels a side have none.

    Walks leave such a cube at once. This is of the marks in memory; those on disk go without.
    """

    def chunk(_: int, first: int, last: int) -> None:
        darken(marks, lattice, first, last)

    workers.run(chunk, -(-lattice.shape[2] // DARKER_CUBE))
