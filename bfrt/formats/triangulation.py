"""Faces of more than three corners as triangles: all of them, those that are not flat, or none.

A polygon lies in one plane. Where a face is not flat its neighbors' planes are others, and a closed
mesh would leak; triangles between corners share their edges with whatever is beside them. A face of
k corners always becomes k - 2 triangles, each corner in one at least, so that only diagonals inside
faces are new::

    quadrilateral       the shorter diagonal of those inside
    others, convex      a fan around the first corner
    others              mapbox_earcut, in the face's plane
"""

from __future__ import annotations

import logging
import math
from collections.abc import Iterator
from typing import Any

import numpy as np
from mapbox_earcut import triangulate_float64
from numpy.typing import NDArray

from bfrt.errors import SceneError
from bfrt.formats._faces import Cut, bent, cut
from bfrt.formats.reading import Reading

log = logging.getLogger(__name__)

#: How far a corner of a flat face may be off its plane: in the distance from the corners' middle to
#: the farthest, and in roundings of the coordinates, of each axis as much as the plane faces it.
FLAT = 1e-6
ROUNDINGS = 2.0

#: What rounding makes of an area, in that of its face.
ROUNDED = 1e-9

#: Corners of a face whose ears are cut, at the most: where it crosses itself everywhere, the time
#: grows with their square.
MOST_EAR_CORNERS = 1 << 17

Triangles = NDArray[np.int64]
Edge = tuple[int, int]


class Triangulation:
    """Decides which faces of a file become triangles, and counts them for a report."""

    def __init__(self, name: str, reading: Reading) -> None:
        self._name = name
        self._all = reading.triangulate
        self._none = reading.polygons
        self._bent = self._made = 0
        self._crossing = 0
        self._first_crossing = -1

    def wanted(self, corners: NDArray[Any], counts: NDArray[np.uint32]) -> NDArray[np.bool_]:
        """Tell which faces become triangles; triangles themselves are among them."""
        if self._all:
            return np.ones(len(counts), np.bool_)
        threes: NDArray[np.bool_] = counts == 3
        if self._none:
            return threes
        found = bent(corners, counts, FLAT, ROUNDINGS * np.finfo(corners.dtype).eps)
        self._bent += int(np.count_nonzero(found))
        self._made += int(counts[found].sum()) - 2 * int(np.count_nonzero(found))
        return threes | found

    def triangles(
        self, corners: NDArray[Any], counts: NDArray[np.uint32], numbers: NDArray[np.int64]
    ) -> NDArray[Any]:
        """Cut faces into triangles (t, 9); else as `cut`."""
        triangles = self.cut(corners, counts, numbers)
        return corners.take(triangles.reshape(-1), axis=0).reshape(-1, 9)

    def cut(
        self, corners: NDArray[Any], counts: NDArray[np.uint32], numbers: NDArray[np.int64]
    ) -> Triangles:
        """Cut faces into triangles of corner indices (t, 3), the k - 2 of a face together.

        Parameters
        ----------
        corners : (m, 3) ndarray
        counts : (n,) uint32
        numbers : (n,) int64
            Number of each face in the file.

        Raises
        ------
        SceneError
            For a face with more than `MOST_EAR_CORNERS` that is not convex.
        """
        triangles = np.empty((len(corners) - 2 * len(counts), 3), np.int64)
        cuts = np.empty(len(counts), np.uint8)
        outlines = np.empty((len(corners), 2))
        cut(corners, counts, triangles, cuts, outlines)
        starts = np.cumsum(counts, dtype=np.int64) - counts
        left = np.flatnonzero(cuts == Cut.EARS)
        for face in left.tolist():
            start, count = int(starts[face]), int(counts[face])
            self._check_corners(count, int(numbers[face]))
            place = start - 2 * face
            triangles[place : place + count - 2] = start + ears(outlines[start : start + count])
        if len(left):
            cut_here = triangles[np.repeat(cuts == Cut.EARS, counts - 2)]
            filled = are_filled(outlines, cut_here, counts[left] - 2)
            cuts[left] = np.where(filled, Cut.RIGHT, Cut.CROSSING)
        crossing = np.flatnonzero(cuts == Cut.CROSSING)
        if len(crossing) and not self._crossing:
            self._first_crossing = int(numbers[crossing[0]])
        self._crossing += len(crossing)
        return triangles

    def _check_corners(self, count: int, number: int) -> None:
        if count > MOST_EAR_CORNERS:
            raise SceneError(
                f"{self._name}: face {number}: found {count} corners that are not convex, expected "
                f"at most {MOST_EAR_CORNERS} to make triangles of, or polygons= to keep it as it is"
            )

    def report(self) -> None:
        """Log how faces were cut."""
        if self._bent:
            log.warning(
                "%s: %s faces that are not flat became %s triangles",
                self._name,
                f"{self._bent:,}",
                f"{self._made:,}",
            )
        if self._crossing:
            log.warning(
                "%s: %s faces cross themselves, the first is face %d: their triangles cover more "
                "or less than they do",
                self._name,
                f"{self._crossing:,}",
                self._first_crossing,
            )


def are_filled(
    outlines: NDArray[np.float64], triangles: Triangles, counts: NDArray[np.uint32]
) -> NDArray[np.bool_]:
    """Tell for which faces no triangle turns the other way, so that they fill the face exactly.

    Parameters
    ----------
    outlines : (m, 2) float64
        The outlines of faces that turn left.
    triangles : (t, 3) int64
        The triangles of one face after the other.
    counts : (n,) uint32
        Number of corners of each face.
    """
    a, b, c = outlines[triangles.T]
    (ux, uy), (vx, vy) = (b - a).T, (c - a).T
    areas = ux * vy - uy * vx
    starts = np.cumsum(counts, dtype=np.int64) - counts
    turned = np.add.reduceat(np.maximum(-areas, 0.0), starts)
    filled: NDArray[np.bool_] = turned <= ROUNDED * np.add.reduceat(areas, starts)
    return filled


def ears(outline: NDArray[np.float64]) -> Triangles:
    """Cut an outline (n, 2) that turns left into n - 2 triangles of corner indices."""
    n = len(outline)
    found = triangulate_float64(outline, np.array([n], np.uint32)).reshape(-1, 3).astype(np.int64)
    if len(found) == n - 2:
        return found
    found = closed(found, outline)
    return found if len(found) == n - 2 else fan(n)


def fan(n: int) -> Triangles:
    """Return the triangles around the first of n corners."""
    second = np.arange(1, n - 1)
    return np.stack([np.zeros_like(second), second, second + 1], axis=1)


def closed(triangles: Triangles, outline: NDArray[np.float64]) -> Triangles:
    """Return triangles with the missing ones between them and the outline added.

    Earcut leaves out corners on a line between two others. What is missing there is a loop of edges
    of no area, so the triangle behind its longest edge is cut up: its tip sees all the others.
    """
    n = len(outline)
    tips = {(t[i - 2], t[i - 1]): t[i] for t in triangles.tolist() for i in range(3)}
    missing = {(i, (i + 1) % n) for i in range(n)} - tips.keys()
    missing |= {(b, a) for a, b in tips if (b, a) not in tips and b != (a + 1) % n}
    for loop in loops(missing):
        edges = list(zip(loop, [*loop[1:], loop[0]], strict=True))
        u, v = max(edges, key=lambda edge: math.dist(*outline[list(edge)]))
        tip = tips.get((v, u), u)
        if tip != u:
            edges.remove((u, v))
            for edge in ((v, u), (u, tip), (tip, v)):
                del tips[edge]
        for a, b in edges:
            if tip not in (a, b):
                tips[a, b] = tip
                tips[b, tip] = a
                tips[tip, a] = b
    made = [(a, b, tip) for (a, b), tip in tips.items() if a < min(b, tip)]
    return np.array(made, np.int64).reshape(-1, 3)


def loops(edges: set[Edge]) -> Iterator[list[int]]:
    """Yield edges joined to loops that meet no corner twice."""
    onward: dict[int, list[int]] = {}
    for a, b in sorted(edges):
        onward.setdefault(a, []).append(b)
    for start in onward:
        path: dict[int, None] = {start: None}  # in order
        last = start
        while onward.get(last):
            last = onward[last].pop()
            if last in path:
                loop = [path.popitem()[0]]
                while loop[-1] != last:
                    loop.append(path.popitem()[0])
                yield loop[::-1]
            path[last] = None
