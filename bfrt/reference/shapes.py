"""The shapes of the independent oracle: where lines meet them, and where that is a close call.

All work on arrays, rays by objects, from the point of each ray that is nearest to the object's
centre, and relative to that centre: the numbers are as small as the object.
"""

from __future__ import annotations

from typing import Protocol

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Indices = NDArray[np.int64]
Mask = NDArray[np.bool_]
Triple = tuple[Array, Array, Array]


class Shapes(Protocol):
    """Provides the objects of one kind that have a surface."""

    index: Indices  # (n,) which ones they are
    centres: Array  # (3, n)

    def roots(self, p: Triple, d: Triple, after: Array, part: slice) -> Array:
        """Return the least t > `after` at which p + t d is on the objects `part`, else inf.

        `p` are points relative to the centres, rays by objects; `d` unit directions, rays by one.
        """


class Spheres:
    def __init__(self, spheres: Array) -> None:
        self.index = np.flatnonzero(spheres[:, 3])
        alive = spheres[self.index].T
        self.centres = alive[:3]
        self.square = alive[3] ** 2

    def roots(self, p: Triple, d: Triple, after: Array, part: slice) -> Array:
        b = _dot(p, d)
        half = np.sqrt(b * b - (_dot(p, p) - self.square[part]))
        return _first(-b - half, -b + half, after)


class Cones:
    def __init__(self, cones: Array) -> None:
        base, apex = cones[:, :3], cones[:, 4:7]
        axis = apex - base
        length = np.sqrt((axis * axis).sum(axis=1))
        self.index = np.flatnonzero((length > 0) & cones[:, [3, 7]].any(axis=1))
        length, alive = length[self.index], cones[self.index]
        self.centres = ((base + apex)[self.index] / 2).T
        self.half = length / 2
        at_base, at_apex = np.abs(alive[:, [3, 7]]).T
        self.radius = (at_base + at_apex) / 2
        self.slope = (at_apex - at_base) / length
        self.axis = axis[self.index].T / length
        self.reach = np.hypot(self.half, np.maximum(at_base, at_apex))

    def roots(self, p: Triple, d: Triple, after: Array, part: slice) -> Array:
        rows = np.arange(len(self.index))[part]
        low, high = self._solve(p, d, rows)
        low = self._kept(low, 0, p, d, rows)
        return _first(low, self._kept(high, 1, p, d, rows), after)

    def _solve(self, p: Triple, d: Triple, rows: Indices, least: float = -np.inf) -> list[Array]:
        """Return the two roots in order, NaN for a negative discriminant; `least` bounds it."""
        axis: Triple = (self.axis[0, rows], self.axis[1, rows], self.axis[2, rows])
        up, rise = _dot(p, axis), _dot(d, axis)
        q, e = _along(p, -up, axis), _along(d, -rise, axis)  # across the axis
        radius, growth = self.radius[rows] + self.slope[rows] * up, self.slope[rows] * rise
        a = _dot(e, e) - growth * growth
        b = _dot(q, e) - radius * growth
        c = _dot(q, q) - radius * radius
        product = -(b + np.copysign(np.sqrt(np.maximum(b * b - a * c, least)), b))
        one, other = product / a, c / product
        return [np.fmin(one, other), np.fmax(one, other)]

    def _kept(self, root: Array, branch: int, p: Triple, d: Triple, rows: Indices) -> Array:
        """Return `root` where it is between base and apex, else NaN.

        Near the tip of a cone both roots fall together and rounding costs half the digits: solved
        again with the origin at the root all terms are small, and the digits come back.
        """
        axis: Triple = (self.axis[0, rows], self.axis[1, rows], self.axis[2, rows])
        near = np.abs(_dot(p, axis) + root * _dot(d, axis)) <= (self.half + 1e-6 * self.reach)[rows]
        ray, column = np.nonzero(near)
        chosen, guess = rows[column], root[near]
        line: Triple = (d[0][ray, 0], d[1][ray, 0], d[2][ray, 0])
        there = _along((p[0][near], p[1][near], p[2][near]), guess, line)
        rest = self._solve(there, line, chosen, least=0.0)[branch]
        rest = np.where(np.isfinite(rest), rest, 0.0)  # the guess is the root: 0 / 0
        axis = (self.axis[0, chosen], self.axis[1, chosen], self.axis[2, chosen])
        inside = np.abs(_dot(_along(there, rest, line), axis)) <= self.half[chosen]
        kept = np.full_like(root, np.nan)
        kept[near] = np.where(inside, guess + rest, np.nan)
        return kept

    def touched(self, p: Triple, d: Triple, margin: Array, part: slice) -> Mask:
        """Tell which surfaces a line stays within `margin` of, all along the object."""
        reach = self.reach[part]
        along: Mask = _dot(p, p) <= (reach + margin) ** 2
        for side in (-reach, 0.0 * reach, reach):  # other lines meet a cone no more than twice
            along &= self._height(_along(p, side, d), part) <= margin
        return along

    def _height(self, p: Triple, part: slice) -> Array:
        axis = _rows(self.axis[:, part])
        up = _dot(p, axis)
        across = _along(p, -up, axis)
        radius = np.abs(self.radius[part] + self.slope[part] * up)
        slant = np.sqrt(1.0 + self.slope[part] ** 2)
        height: Array = np.abs(np.sqrt(_dot(across, across)) - radius) / slant
        return height


class Triangles:
    def __init__(self, corners: Array) -> None:
        a, b, c = corners[:, :3], corners[:, 3:6], corners[:, 6:9]
        normal = np.cross(b - a, c - a)
        self.index = np.flatnonzero(normal.any(axis=1))
        a, b, c = a[self.index], b[self.index], c[self.index]
        middle = (a + b + c) / 3
        self.centres = middle.T
        self.corner, self.one, self.two = (a - middle).T, (b - a).T, (c - a).T
        far = np.stack([a, b, c]) - middle
        self.slack = 1e-9 * np.sqrt((far * far).sum(axis=2)).max(axis=0)

    def roots(self, p: Triple, d: Triple, after: Array, part: slice) -> Array:
        one, two = _rows(self.one[:, part]), _rows(self.two[:, part])
        from_corner = _along(p, np.array(-1.0), _rows(self.corner[:, part]))
        across = _cross(d, two)
        scale = 1.0 / _dot(one, across)
        u = _dot(from_corner, across) * scale
        turned = _cross(from_corner, one)
        v = _dot(d, turned) * scale
        t = _dot(two, turned) * scale
        inside = (u >= 0) & (v >= 0) & (u + v <= 1)
        return np.where(inside & self._beside(t, d, part) & (t > after), t, np.inf)

    def _beside(self, t: Array, d: Triple, part: slice) -> Mask:
        """Tell whether t is between the corners along the ray: edge on, u, v and t are noise."""
        a = _dot(_rows(self.corner[:, part]), d)
        b, c = a + _dot(_rows(self.one[:, part]), d), a + _dot(_rows(self.two[:, part]), d)
        low, high = np.minimum(a, np.minimum(b, c)), np.maximum(a, np.maximum(b, c))
        beside: Mask = (t >= low - self.slack[part]) & (t <= high + self.slack[part])
        return beside


class Polygons:
    def __init__(self, vertices: Array, counts: Indices, block: int) -> None:
        self.block = block
        first = np.cumsum(counts) - counts
        middle = _reduced(np.add, vertices, first) / counts[:, None]
        owner = np.repeat(np.arange(len(counts)), counts)
        around = vertices - middle[owner]
        following = around[_following(first, counts)]
        normal = _reduced(np.add, np.cross(around, following), first)
        drop = np.abs(normal).argmax(axis=1)
        self.index = np.flatnonzero(normal.any(axis=1))
        self.centres = middle[self.index].T
        self.normal = normal[self.index].T
        self.first, self.counts = first[self.index], counts[self.index]
        self.flat = np.stack([(drop + 1) % 3, (drop + 2) % 3])[:, self.index]
        self.edges = np.stack([around, following])  # (2, m, 3), relative to the centres
        dropped = np.arange(3)[:, None] == drop[self.index]  # no limit along that axis
        low = _reduced(np.minimum, around, first)[self.index].T
        high = _reduced(np.maximum, around, first)[self.index].T
        self.low, self.high = np.where(dropped, -np.inf, low), np.where(dropped, np.inf, high)

    def roots(self, p: Triple, d: Triple, after: Array, part: slice) -> Array:
        normal = _rows(self.normal[:, part])
        t = -_dot(normal, p) / _dot(normal, d)
        place = _along(p, t, d)
        near = t > after
        for x, low, high in zip(place, self.low[:, part], self.high[:, part], strict=True):
            near &= (x >= low) & (x <= high)
        column = np.nonzero(near)[1] + part.start
        points = np.stack([x[near] for x in place])
        near[near] = self._inside(points, column)
        return np.where(near, t, np.inf)

    def _inside(self, points: Array, rows: Indices) -> Mask:
        """Tell which of `points` (3, k) are inside the polygons `rows` (k,), one each."""
        inside = np.zeros(len(rows), np.bool_)
        counts = self.counts[rows]
        parts = (np.cumsum(counts) - counts) // self.block  # about a block of edges each
        for part in np.unique(parts):
            some = np.flatnonzero(parts == part)
            inside[some] = self._odd(points[:, some], rows[some])
        return inside

    def _odd(self, points: Array, rows: Indices) -> Mask:
        counts = self.counts[rows]
        start = np.cumsum(counts) - counts
        pair = np.repeat(np.arange(len(rows)), counts)
        edge = np.repeat(self.first[rows] - start, counts) + np.arange(counts.sum())
        ax, ay, bx, by = (
            self.edges[end, edge, axis[pair]] - points[axis[pair], pair]
            for end in (0, 1)
            for axis in self.flat[:, rows]
        )
        angle = np.arctan2(ax * by - ay * bx, ax * bx + ay * by)
        turns = np.rint(np.add.reduceat(angle, start) / (2 * np.pi))
        odd: Mask = turns % 2 == 1
        return odd


class Edges:
    """Holds the edges of flat objects and the tips of cones: segments, some of no length."""

    def __init__(self, corners: Array, vertices: Array, counts: Indices, cones: Array) -> None:
        faces = corners[Triangles(corners).index].reshape(-1, 3, 3)
        first = np.cumsum(counts) - counts
        alive = np.zeros(len(counts), np.bool_)
        alive[Polygons(vertices, counts, 1).index] = True
        kept = np.repeat(alive, counts)
        tips = np.concatenate([cones[cones[:, 3] == 0, :3], cones[cones[:, 7] == 0, 4:7]])
        start = np.concatenate([faces.reshape(-1, 3), vertices[kept], tips])
        turned = np.roll(faces, -1, axis=1).reshape(-1, 3)
        end = np.concatenate([turned, vertices[_following(first, counts)][kept], tips])
        self.index = np.arange(len(start))
        self.centres = ((start + end) / 2).T
        self.half = ((end - start) / 2).T
        self.reach = np.sqrt((self.half * self.half).sum(axis=0))

    def touched(self, p: Triple, d: Triple, margin: Array, part: slice) -> Mask:
        """Tell which segments a line passes by no more than `margin`."""
        half = _rows(self.half[:, part])
        across = _along(half, -_dot(half, d), d)  # as seen along the line, which is a point then
        nearest = np.clip(_dot(p, across) / _dot(across, across), -1.0, 1.0)
        nearest = np.where(np.isnan(nearest), 0.0, nearest)  # seen end on: 0 / 0
        gap = _along(p, -nearest, across)
        close: Mask = _dot(gap, gap) <= margin * margin
        return close


def _following(first: Indices, counts: Indices) -> Indices:
    """Return for every vertex the row of its polygon's next one."""
    rows = np.arange(1, counts.sum() + 1)
    rows[first + counts - 1] = first
    return rows


def _reduced(over: np.ufunc, values: Array, first: Indices) -> Array:
    """Reduce the vertices of each polygon by `over`."""
    return np.asarray(over.reduceat(values, first, axis=0) if len(first) else values, np.float64)


def _first(low: Array, high: Array, after: Array) -> Array:
    """Return the lesser root if it is after `after`, else the greater; never a NaN."""
    return np.where(low > after, low, np.where(high > after, high, np.inf))


def _dot(a: Triple, b: Triple) -> Array:
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def _cross(a: Triple, b: Triple) -> Triple:
    return (
        a[1] * b[2] - a[2] * b[1],
        a[2] * b[0] - a[0] * b[2],
        a[0] * b[1] - a[1] * b[0],
    )


def _along(p: Triple, t: Array, d: Triple) -> Triple:
    """Return the points p + t d."""
    return (p[0] + t * d[0], p[1] + t * d[1], p[2] + t * d[2])


def _rows(table: Array) -> Triple:
    return (table[0], table[1], table[2])


def approach(centres: Array, start: Array, unit: Array) -> tuple[Array, Triple, Triple]:
    """Return each ray's t nearest to each centre, its point there as seen from it, directions."""
    d = _rows(unit[:, :, None])
    x, y, z = centres[:, None, :] - start[:, :, None]
    ahead = _dot((x, y, z), d)
    return ahead, (ahead * d[0] - x, ahead * d[1] - y, ahead * d[2] - z), d
