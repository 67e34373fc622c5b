"""Bounds of a group as it is written, and the outliers that its grid is better without.

A few objects far larger than the rest (a ground polygon) would make a grid in which all others
share a few voxels. The largest boxes are kept aside. The boxes whose absence at least halves the
grid's volume stay out of it (docs/algorithm.rst, Outliers); every ray is tested against them first.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from bfrt.errors import SceneError
from bfrt.store._bounds import LargestBoxes, around, around_points
from bfrt.store.model import Vector

#: The shortest axis of a grid, as a part of its diagonal: a flat scene has a grid too.
FLATTEST = 2.0**-10

#: The shortest diagonal of a scene, as a part of how far it is from the origin: 16 units in the
#: last place of float64, which is what a ray of world coordinates can tell apart.
SMALLEST = 2.0**-48


class Bounds(NamedTuple):
    """Holds an axis-parallel box, float64, relative to the store's origin; (3,) each."""

    lo: NDArray[np.float64]
    hi: NDArray[np.float64]

    @property
    def empty(self) -> bool:
        return bool(self.lo[0] > self.hi[0])

    @property
    def diagonal(self) -> float:
        return 0.0 if self.empty else float(np.sqrt(((self.hi - self.lo) ** 2).sum()))

    @property
    def reach(self) -> float:
        """Return the greatest coordinate, whatever its sign."""
        return 0.0 if self.empty else float(np.abs(self).max())

    @property
    def surface(self) -> float:
        """Return the area of all six faces."""
        x, y, z = (0.0, 0.0, 0.0) if self.empty else (self.hi - self.lo).tolist()
        return float(2.0 * (x * y + y * z + z * x))

    def union(self, other: Bounds) -> Bounds:
        return Bounds(np.minimum(self.lo, other.lo), np.maximum(self.hi, other.hi))

    def grid_sides(self) -> NDArray[np.float64]:
        """Return the side lengths, with flat axes thickened."""
        sides: NDArray[np.float64] = np.maximum(self.hi - self.lo, FLATTEST * self.diagonal)
        return sides


NOTHING = Bounds(np.full(3, np.inf), np.full(3, -np.inf))


def bounds_of(boxes: NDArray[np.float32]) -> Bounds:
    """Return the union of boxes (n, 6); boxes of degenerate objects (inf, -inf) add nothing."""
    sides = around(boxes)
    return Bounds(sides[:3], sides[3:])


def bounds_of_points(points: NDArray[np.float32]) -> Bounds:
    """Return the bounds of points (n, 3)."""
    sides = around_points(points)
    return Bounds(sides[:3], sides[3:])


def check_extent(bounds: Bounds, origin: Vector) -> None:
    """Refuse a scene that is too small for where it is.

    Parameters
    ----------
    bounds : Bounds
        All objects', relative to `origin`.
    origin : tuple of 3 float
        The store's origin.

    Raises
    ------
    SceneError
        If float64 cannot tell the scene's parts apart; a scene of one point has none.
    """
    reach = max(bounds.reach, max(map(abs, origin)))
    least = SMALLEST * reach
    if 0.0 < bounds.diagonal < least:
        x, y, z = ((bounds.lo + bounds.hi) / 2 + origin).tolist()
        raise SceneError(
            f"scene: found all objects within {bounds.diagonal:.3g} at {x:g} {y:g} {z:g}, expected "
            f"{least:.3g} or more across so far from the origin, where coordinates are rounded"
        )


class Extent:
    """Gathers bounds, and the largest boxes, over all blocks of a group."""

    def __init__(self) -> None:
        self._largest = LargestBoxes()

    def add(self, boxes: NDArray[np.float32], first: int) -> None:
        """Take in boxes (n, 6) of objects whose ids go on from `first`, in any order of blocks."""
        self._largest.add(boxes, first)

    @property
    def bounds(self) -> Bounds:
        """Return the bounds of all objects."""
        return self._without(self._largest.boxes)

    def _without(self, kept: NDArray[np.float32]) -> Bounds:
        """Return the bounds of the boxes that are not among the largest, and of those of them that
        are `kept`.
        """
        rest = self._largest.rest
        return Bounds(rest[:3], rest[3:]).union(bounds_of(kept))

    def outliers(self) -> tuple[list[int], Bounds]:
        """Return the ids that stay out of the grid, ascending, and the bounds of all others."""
        ids, boxes = self._largest.ids, self._largest.boxes
        left = [self._without(boxes[k:]) for k in range(len(ids) + 1)]
        volumes = [0.0 if b.empty else float(np.prod(b.grid_sides())) for b in left]
        out = 0
        for k in range(1, len(left)):
            if 0.0 < volumes[out] >= 2 * volumes[k] and not left[k].empty:
                out = k
        return sorted(int(i) for i in ids[:out]), left[out]
