"""One object against rays, by the compiled kernels alone: no store, no grid."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scenes import units

from bfrt.records import Kind
from bfrt.reference import _kernels

Array = NDArray[np.float64]


class Met(NamedTuple):
    """What rays met: an object's box, and for each ray t, the point, normals, uv, its place
    on the surface, and how many crossings the object owns."""

    box: NDArray[np.float32]
    t: Array
    points: Array
    geometric: Array
    shading: Array
    uv: Array
    places: Array
    crossings: NDArray[np.int64]

    @property
    def hit(self) -> NDArray[np.bool_]:
        return np.isfinite(self.t)


def meet(
    kind: Kind,
    record: ArrayLike,
    origins: ArrayLike,
    directions: ArrayLike,
    padding: float = np.inf,
    origin: ArrayLike = (0.0, 0.0, 0.0),
) -> Met:
    """Meet the object; a box padded by inf excludes nothing, so the kernel is on its own."""
    start = np.ascontiguousarray(origins, np.float64)
    way = np.ascontiguousarray(directions, np.float64)
    numbers = np.array(record, np.float64).reshape(-1)
    offset = list(np.array(origin))
    box, t, surface, crossings = _kernels.meet(kind, numbers, offset, padding, start, way)
    with np.errstate(invalid="ignore"):
        points = start + t[:, None] * way
    geometric, shading, uv, places = np.split(surface, [3, 6, 8], axis=1)
    return Met(box, t, points, geometric, shading, uv, places, crossings)


def rays_through(rng: np.random.Generator, box: ArrayLike, n: int) -> tuple[Array, Array]:
    """Rays from around a box (6,) through points in it; every second starts inside."""
    low, high = np.array(box, np.float64).reshape(2, 3)
    size = max(float((high - low).max()), 1e-30)
    target = rng.uniform(low, high, (n, 3))
    distance = size * rng.uniform(0.0, 5.0, (n, 1)) * (rng.random((n, 1)) < 0.5)
    direction = units(rng, n)
    origin = rng.uniform(low, high, (n, 3))
    origin = np.where(distance > 0, target - (distance + size) * direction, origin)
    return origin, direction


def outside(box: ArrayLike, points: Array) -> Array:
    """How far each point is outside of a box, at most along any axis; 0 for inside."""
    low, high = np.array(box, np.float64).reshape(2, 3)
    far: Array = np.maximum(np.maximum(low - points, points - high), 0.0).max(axis=1)
    return far
