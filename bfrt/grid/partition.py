"""Grids cut to the memory that there is (the paper's section 3.2).

::

    voxels        cubes, about as many as objects           marks on disk, in bricks
    subspaces     layers of voxels, across the longest axis preprocessed one by one
    slabs         layers too, as many as memory holds       traversed one by one
    upper voxels  1, 2 or 4 voxels a side                   where rays are stored
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from bfrt.errors import BudgetError
from bfrt.grid.bricks import BRICK, BRICK_BYTES
from bfrt.grid.marks_layout import Shape, bricks_of
from bfrt.records import VOXEL_BITS
from bfrt.store.extent import Bounds
from bfrt.store.store import Group

#: Voxels for each object of the grid. One is the rule's; two measured better, with entry marks,
#: on rings of 8 thousand and of a million objects: fewer boxes to test, few more steps to walk.
VOXELS_EACH = 2

#: The paper's Rl: voxels a side of an upper voxel at the most, as a power of two.
LOWER_BITS = 2

#: Tries of fewer voxels, a tenth fewer each time: from 2^64 to far below one.
MOST_CUTS = 1000


class Limits(NamedTuple):
    """Holds the limits of a grid: what memory has room for, and what the caller asks for.

    Attributes
    ----------
    voxels : int
        The most voxels of the grid.
    slab : int
        Voxels of a slab: a layer of bricks at least.
    single : int
        Upper voxels that are cheap enough to be voxels: the paper's Ru, cubed.
    uppers : int
        Upper voxels at the most.
    grid : int, optional
        Voxels on the longest axis, whatever the rule says.
    max_grid : int, optional
        Voxels on the longest axis at the most.
    """

    voxels: int
    slab: int
    single: int
    uppers: int
    grid: int | None = None
    max_grid: int | None = None


class Partition(NamedTuple):
    """Holds a grid's resolution, and how it is cut.

    Attributes
    ----------
    shape : tuple of 3 int
        Voxels an axis.
    axis : int
        Across the slabs: the longest.
    lower_bits : int
        An upper voxel is 2^lower_bits voxels a side.
    """

    shape: Shape
    axis: int
    lower_bits: int

    @property
    def voxels(self) -> int:
        return math.prod(self.shape)

    @property
    def uppers(self) -> int:
        """Return the number of upper voxels."""
        return uppers_of(self.shape, self.lower_bits)

    @property
    def bricks(self) -> int:
        """Return the number of bricks, empty ones included."""
        return math.prod(bricks_of(self.shape))


def uppers_of(shape: Shape, bits: int) -> int:
    """Return the number of upper voxels, 2^bits voxels a side, that cover a grid."""
    return math.prod(-(-n >> bits) for n in shape)


def longest(shape: Shape) -> int:
    """Return the longest axis; of equal ones the last."""
    return max(range(3), key=lambda k: (shape[k], k))


def resolution(bounds: Bounds, voxels: float) -> Shape:
    """Return the voxels an axis of a grid of about `voxels` cubic ones.

    The rule is Klimaszewski and Sederberg's (1997).
    """
    sides = bounds.grid_sides()
    side = float(np.prod(sides / sides.max())) ** (1 / 3) * float(sides.max())
    side /= voxels ** (1 / 3)
    shape = np.maximum(1, np.rint(sides / side)).astype(np.int64)
    return (int(shape[0]), int(shape[1]), int(shape[2]))


def along_longest(bounds: Bounds, most: int) -> Shape:
    """Return the voxels an axis of a grid of cubic ones, `most` of them on the longest axis."""
    sides = bounds.grid_sides()
    shape = np.clip(np.rint(sides / sides.max() * float(most)), 1, 1 << 62)
    x, y, z = shape.astype(np.int64).tolist()
    return (x, y, z)


def partition_of(group: Group, limits: Limits) -> Partition:
    """Choose the grid of a group.

    Raises
    ------
    BudgetError
        If memory does not hold the one that is asked for.
    """
    found = partition(group.grid_bounds, group.gridded, limits)
    if found is None:
        raise BudgetError(
            f"grid: found {limits.grid} voxels on the longest axis, expected fewer or more memory"
        )
    return found


def partition(bounds: Bounds, objects: int, limits: Limits) -> Partition | None:
    """Choose the grid for a number of objects; None if memory cannot hold the one asked for."""
    if bounds.empty or objects == 0 or not bounds.grid_sides().all():
        return Partition((1, 1, 1), 2, 0)  # nothing, or one point: any voxel will do
    if limits.grid is not None:
        return cut(along_longest(bounds, limits.grid), limits)
    voxels = float(max(1, min(VOXELS_EACH * objects, limits.voxels)))
    for _ in range(MOST_CUTS):
        shape = resolution(bounds, voxels)
        if limits.max_grid is not None and max(shape) > limits.max_grid:
            shape = along_longest(bounds, limits.max_grid)
        found = cut(shape, limits)
        if found is not None or max(shape) == 1:
            return found
        voxels = min(voxels * 0.9, math.prod(shape))
    return None


def cut(shape: Shape, limits: Limits) -> Partition | None:
    """Cut a grid into slabs and upper voxels; None where memory cannot hold them."""
    axis = longest(shape)
    bricks = bricks_of(shape)
    layer = math.prod(bricks) // bricks[axis] * BRICK_BYTES
    if math.prod(shape) > limits.voxels or layer > limits.slab:
        return None
    for bits in range(LOWER_BITS + 1):
        uppers = uppers_of(shape, bits)
        if uppers << 3 * bits > 1 << VOXEL_BITS:  # a candidate's voxel has so many bits
            return None
        if uppers <= (limits.single if bits < LOWER_BITS else limits.uppers):
            return Partition(shape, axis, bits)
    return None


def subspaces(layered: Shape, most: int, begin: int = 0) -> Iterator[tuple[int, int]]:
    """Yield each subspace's first layer and end: whole bricks of `most` voxels, one at least.

    The first `begin` layers of bricks are left out.

    The paper's are cubes, for most parent boxes lie outside one (its figure 3). Few parents are cut
    either way where they are small; but what lies in a cube comes in many short runs, and the gaps
    between are read through. Layers also come in the order in which marks are kept.
    """
    layers = -(-layered[0] // BRICK) - begin
    fit = max(1, most // (BRICK * layered[1] * layered[2]))
    count = -(-layers // fit)
    for number in range(count):
        first, end = ((begin + layers * n // count) * BRICK for n in (number, number + 1))
        yield first, min(end, layered[0])
