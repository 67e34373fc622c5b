"""An oracle for the nearest hit: NumPy only, other formulas than the compiled core's.

::

    origin o ──────── start ────────► p  (the ray's point nearest to the object's centre)
                                      │ solve there, in small numbers: t = start + root
                                      ▼
    sphere      the quadratic of |p + t d|^2 = r^2
    cone        the quadratic of |q|^2 = (r + k z)^2, solved twice: the second time at the root
    triangle    Möller and Trumbore, "Fast, minimum storage ray/triangle intersection" (1997)
    polygon     Newell's plane, then the winding number as a sum of angles

It visits every pair of ray and object, a block of pairs at a time, and shares with the core only
the conventions:

- surfaces are two-sided, and a negative radius means the same surface;
- a cone has no end caps, and its radius is linear along the axis;
- a patch is a triangle: three corners, then three normals;
- a polygon may be concave; its plane has Newell's normal and goes through the mean of its vertices,
  its inside has an odd winding number, seen along the normal's largest axis (the core looks along
  the ray, which matters only where it is not quite flat);
- touching counts, and degenerate objects are never hit;
- an id is ``kind << 48 | index``, and the nearest hit is the least (t, id) with 0 < t < t_max.

Two programs that round differently may answer differently where a ray meets an edge: `stable` finds
the rays for which that is no excuse, and `agree` compares those.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike, NDArray

from bfrt.errors import SceneError
from bfrt.records import INDEX_BITS, NO_HIT, SCALARS, Kind
from bfrt.reference.shapes import (
    Array,
    Cones,
    Edges,
    Indices,
    Mask,
    Polygons,
    Shapes,
    Spheres,
    Triangles,
    approach,
)

Ids = NDArray[np.uint64]

#: Pairs of ray and object: their arrays of 128 KiB stay in the cache.
PAIRS_AT_ONCE = 1 << 14
CHUNK = 1 << 12  # of them, objects

#: Two programs may differ by this many units in the last place of the way to an object, times the
#: hundred that `stable` lets an error grow: then they agree to 1e-9 wherever `stable` says so.
ROUNDING = 1024 * float(np.finfo(np.float64).eps)

#: A ray is nudged by so much of the way to its hit, and its t may then move by so much of itself.
NUDGE = 1e-9
NUDGED_RTOL = 1e-7

#: A ray touches an edge if it passes by it within so many times what it is nudged.
MARGIN = 8.0

# Three directions that no axis, face or diagonal is likely to contain; both signs are used, so that
# on either side of any plane through a ray there is a nudged one.
_NUDGES = np.array(
    [
        [0.4242640687, 0.5656854249, 0.7071067812],
        [-0.8660254038, 0.4811252243, 0.1360827635],
        [-0.2672612419, -0.6668859289, 0.6955864289],
    ]
)


def _empty(columns: int) -> Array:
    return np.empty((0, columns))


@dataclass(frozen=True, eq=False)
class Objects:
    """Holds the objects of a scene as arrays of float64; kinds left out are empty.

    Parameters
    ----------
    spheres : (n, 4)
        Centre, radius.
    cones : (n, 8)
        Base, radius there, apex, radius there.
    triangles : (n, 9)
        Three corners.
    patches : (n, 18)
        Three corners, three normals.
    vertices : (m, 3)
        The vertices of all polygons, one polygon after another.
    counts : (n,)
        Number of vertices of each polygon, at least three.

    Raises
    ------
    SceneError
        If a shape is wrong, a number is not finite, or the counts do not add up.
    """

    spheres: Array = field(default_factory=lambda: _empty(SCALARS[Kind.SPHERE]))
    cones: Array = field(default_factory=lambda: _empty(SCALARS[Kind.CONE]))
    triangles: Array = field(default_factory=lambda: _empty(SCALARS[Kind.TRIANGLE]))
    patches: Array = field(default_factory=lambda: _empty(SCALARS[Kind.PATCH]))
    vertices: Array = field(default_factory=lambda: _empty(SCALARS[Kind.POLYGON]))
    counts: Indices = field(default_factory=lambda: np.empty(0, np.int64))

    def __post_init__(self) -> None:
        names = ("spheres", "cones", "triangles", "patches", "vertices")
        for name, columns in zip(names, SCALARS.values(), strict=True):
            object.__setattr__(self, name, _table(name, getattr(self, name), columns))
        counts = np.asarray(self.counts)
        if counts.ndim != 1 or counts.dtype.kind not in "iu":
            raise SceneError(
                f"counts: found {counts.dtype} of shape {counts.shape}, expected integers (n,)"
            )
        if counts.size and counts.min() < 3:
            raise SceneError(f"counts: found {counts.min()}, expected 3 vertices or more")
        if counts.sum() != len(self.vertices):
            raise SceneError(
                f"vertices: found {len(self.vertices)}, expected the {counts.sum()} of counts"
            )
        object.__setattr__(self, "counts", counts.astype(np.int64))

    def __len__(self) -> int:
        tables = (self.spheres, self.cones, self.triangles, self.patches, self.counts)
        return sum(map(len, tables))

    def bounds(self) -> tuple[Array, Array]:
        """Return the lower and upper corner of a box around all objects, zeros if none.

        Around a cone it is looser than need be.
        """
        if not len(self):
            return np.zeros(3), np.zeros(3)
        wide = np.abs(self.cones[:, [3, 7]]).max(axis=1, keepdims=True)
        balls = np.vstack(
            [
                np.hstack([self.spheres[:, :3], np.abs(self.spheres[:, 3:])]),
                np.hstack([self.cones[:, :3], wide]),
                np.hstack([self.cones[:, 4:7], wide]),
            ]
        )
        points = np.vstack(
            [
                balls[:, :3] - balls[:, 3:],
                balls[:, :3] + balls[:, 3:],
                self.triangles.reshape(-1, 3),
                self.patches[:, :9].reshape(-1, 3),
                self.vertices,
            ]
        )
        return points.min(axis=0), points.max(axis=0)


def _table(name: str, values: ArrayLike, columns: int) -> Array:
    table = np.asarray(values, np.float64)
    if table.ndim != 2 or table.shape[1] != columns:
        raise SceneError(f"{name}: found shape {table.shape}, expected (n, {columns})")
    if not np.isfinite(table).all():
        row = int(np.flatnonzero(~np.isfinite(table).all(axis=1))[0])
        raise SceneError(f"{name}: row {row}: found {table[row]}, expected finite numbers")
    return table


# --- the nearest hit ---------------------------------------------------------------------------


def nearest(
    objects: Objects,
    origins: ArrayLike,
    directions: ArrayLike,
    t_max: ArrayLike = np.inf,
    block: int = PAIRS_AT_ONCE,
) -> tuple[Array, Ids]:
    """Find the nearest hit of each ray by trying every object.

    Parameters
    ----------
    objects : Objects
    origins, directions : (n, 3)
        The rays; directions of any length but zero.
    t_max : float or (n,)
        Hits are nearer than this.
    block : int
        Pairs of ray and object in memory at once. It changes no bit of the answer.

    Returns
    -------
    t : (n,) float64
        In lengths of the direction; inf for a miss.
    id : (n,) uint64
        ``kind << 48 | index``, NO_HIT for a miss. A ray with a NaN, or of zero length, misses.
    """
    start, unit, length = _lines(origins, directions)
    limit = np.broadcast_to(np.asarray(t_max, np.float64), length.shape)
    t = np.full(len(length), np.inf)
    ids = np.full(len(length), NO_HIT, np.uint64)
    with np.errstate(all="ignore"):
        for kind, shapes in _kinds(objects, block):
            for rays, part in _blocks(len(length), len(shapes.index), block):
                found, row = _nearest_of(shapes, part, start[:, rays], unit[:, rays], length[rays])
                better = (found < t[rays]) & (found < limit[rays])  # ids only grow: never a tie
                t[rays][better] = found[better]
                name = shapes.index[row[better]].astype(np.uint64)
                ids[rays][better] = name | np.uint64(kind << INDEX_BITS)
    return t, ids


def _unit(vectors: Array) -> Array:
    """Divide vectors (3, n) by their lengths; NaN for zero."""
    scaled = vectors / np.abs(vectors).max(axis=0)  # first, so that no square vanishes
    unit: Array = scaled / np.sqrt((scaled * scaled).sum(axis=0))
    return unit


def _lines(origins: ArrayLike, directions: ArrayLike) -> tuple[Array, Array, Array]:
    """Return origins and unit directions, (3, n) each, and lengths; NaN for zero directions."""
    start = np.atleast_2d(np.asarray(origins, np.float64)).T
    way = np.atleast_2d(np.asarray(directions, np.float64)).T
    with np.errstate(all="ignore"):
        unit = _unit(way)
        return start, unit, (way * unit).sum(axis=0)


def _kinds(objects: Objects, block: int) -> Iterator[tuple[Kind, Shapes]]:
    yield Kind.SPHERE, Spheres(objects.spheres)
    yield Kind.CONE, Cones(objects.cones)
    yield Kind.TRIANGLE, Triangles(objects.triangles)
    yield Kind.PATCH, Triangles(objects.patches[:, :9])
    yield Kind.POLYGON, Polygons(objects.vertices, objects.counts, block)


def _blocks(rays: int, shapes: int, block: int) -> Iterator[tuple[slice, slice]]:
    wide = max(1, min(shapes, CHUNK, block))
    high = max(1, block // wide)
    for ray in range(0, rays, high):
        for shape in range(0, shapes, wide):
            yield slice(ray, ray + high), slice(shape, shape + wide)


def _nearest_of(
    shapes: Shapes, part: slice, start: Array, unit: Array, length: Array
) -> tuple[Array, Indices]:
    """Find the least t of each ray over the shapes `part`, and the index of the shape."""
    ahead, p, d = approach(shapes.centres[:, part], start, unit)
    t = (ahead + shapes.roots(p, d, -ahead, part)) / length[:, None]
    row = t.argmin(axis=1)
    return t[np.arange(len(t)), row], row + part.start


# --- where two programs must agree -------------------------------------------------------------


def stable(
    objects: Objects,
    origins: ArrayLike,
    directions: ArrayLike,
    t: Array,
    ids: Ids,
    t_max: ArrayLike = np.inf,
) -> Mask:
    """Tell which rays keep their hit when they are nudged a little.

    The origin is moved by `NUDGE` times the way to the hit (but no more than the scene's diagonal),
    and `ROUNDING` times the way to the scene's far end; the direction is turned so that the ray
    moves by as much at the hit. So a ray from far away is nudged by what it is to the scene, not by
    what it is to the distance. A ray that passes within `MARGIN` times that of an edge or a tip, or
    runs along the side of a cone, is not stable either: six rays may all miss a narrow corner.

    Parameters
    ----------
    objects, origins, directions, t_max
        As for `nearest`.
    t, ids : (n,)
        What `nearest` answers for these rays. (Not what the program under test answers: where that
        is wrong, no nudged ray would agree, and the error would pass as unstable.)
    Returns
    -------
    (n,) bool
        True where all six nudged rays have the same id, and t within `NUDGED_RTOL` of it.
    """
    start = np.atleast_2d(np.asarray(origins, np.float64))
    way = np.atleast_2d(np.asarray(directions, np.float64))
    length = np.linalg.norm(way, axis=1)
    shift, turn = _amounts(objects, start, t * length)
    same = ~_touching(objects, start, way, t * length, MARGIN * shift)
    for move, swing in zip(_NUDGES, np.roll(_NUDGES, -1, axis=0), strict=True):
        for sign in (-1.0, 1.0):
            moved = start + (sign * shift)[:, None] * move
            swung = way + (sign * turn * length)[:, None] * swing
            there, name = nearest(objects, moved, swung, t_max)
            same &= (name == ids) & _close(there, t, NUDGED_RTOL)
    return same


def _amounts(objects: Objects, start: Array, way: Array) -> tuple[Array, Array]:
    """Return how far to move each origin, and by what part of its length to turn each direction."""
    low, high = objects.bounds()
    diagonal = float(np.linalg.norm(high - low))
    reach = np.linalg.norm(np.maximum(np.abs(low - start), np.abs(high - start)), axis=1)
    coarse = reach + np.abs(start).max(axis=1, initial=0.0)
    shift = NUDGE * np.minimum(way, diagonal) + ROUNDING * coarse
    with np.errstate(divide="ignore", invalid="ignore"):
        turn = np.fmin(shift / np.minimum(way, reach), 1.0)
    return shift, turn


def _touching(objects: Objects, start: Array, way: Array, end: Array, margin: Array) -> Mask:
    """Tell which rays pass, before `end`, within `margin` of where a surface ends or turns."""
    found = np.zeros(len(start), np.bool_)
    origins, unit, _ = _lines(start, way)
    corners = np.concatenate([objects.triangles, objects.patches[:, :9]])
    edges = Edges(corners, objects.vertices, objects.counts, objects.cones)
    with np.errstate(all="ignore"):
        for sharp in (edges, Cones(objects.cones)):
            for rays, part in _blocks(len(start), len(sharp.index), PAIRS_AT_ONCE):
                ahead, p, d = approach(sharp.centres[:, part], origins[:, rays], unit[:, rays])
                near = margin[rays, None]
                reach = sharp.reach[part] + near
                passed = (ahead >= -reach) & (ahead <= end[rays, None] + reach)
                found[rays] |= (passed & sharp.touched(p, d, near, part)).any(axis=1)
    return found


def _close(a: Array, b: Array, rtol: float) -> Mask:
    with np.errstate(invalid="ignore"):
        near = np.isfinite(a) & np.isfinite(b) & (np.abs(a - b) <= rtol * np.minimum(a, b))
    both: Mask = near | (a == b)
    return both


@dataclass(frozen=True, eq=False)
class Agreement:
    """Counts the rays that `agree` compared.

    Parameters
    ----------
    compared, unstable : int
        Rays that had to agree, and rays that were left out.
    tied : int
        Of those compared, how many name another object at the same t: right only for objects that
        coincide.
    wrong : int
        Of those compared, how many differ in t, or call a hit a miss.
    rows : (wrong,)
        Which ones.
    """

    compared: int
    unstable: int
    tied: int
    wrong: int
    rows: Indices


def agree(
    t: Array, ids: Ids, t2: Array, ids2: Ids, stable_mask: Mask, rtol: float = 1e-9
) -> Agreement:
    """Compare two programs' answers where `stable_mask` demands it."""
    hit = ids != np.uint64(NO_HIT)
    honest = (hit == np.isfinite(t)) & ((ids2 != np.uint64(NO_HIT)) == np.isfinite(t2))
    same = honest & _close(t, t2, rtol)
    rows = np.flatnonzero(stable_mask & ~same)
    return Agreement(
        compared=int(stable_mask.sum()),
        unstable=int((~stable_mask).sum()),
        tied=int((stable_mask & same & (ids != ids2)).sum()),
        wrong=len(rows),
        rows=rows,
    )
