"""The slow twin of ambient occlusion: NumPy's own sine and cosine, and every ray against all.

It shares with the shading loop what `Shader.look_around` says: which directions a hash of pixel and
sample chooses. What stops a ray is decided by `exhaustive`.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from bfrt.reference import exhaustive
from bfrt.store.store import Store

Array = NDArray[np.float64]
Words = NDArray[np.uint64]

_GOLDEN = 0x9E3779B97F4A7C15


def openness(
    store: Store,
    places: Array,
    normals: Array,
    seeds: Words,
    rays: int,
    distance: float = np.inf,
) -> Array:
    """Find which part of the rays from each place meets nothing within a distance.

    Parameters
    ----------
    store : Store
    places : (n, 3)
        A little above the surface, relative to the store's origin.
    normals : (n, 3)
        Unit vectors, to the side that is seen.
    seeds : (n,) uint64
        As `seeds_of` makes them.
    rays : int
        From each place.
    distance : float

    Returns
    -------
    (n,) float64
    """
    ways = directions(normals, seeds, rays).reshape(-1, 3)
    dark = exhaustive.occluded(store, np.repeat(places, rays, axis=0), ways, distance)
    part: Array = 1.0 - dark.reshape(-1, rays).mean(axis=1)
    return part


def seeds_of(pixels: ArrayLike, samples: ArrayLike) -> Words:
    """Return the seed of each hit, by its film element and its sample."""
    frame = np.asarray(pixels, np.uint64) + np.uint64(1 << 32)
    return mixed(mixed(frame) + np.asarray(samples, np.uint64))


def directions(normals: Array, seeds: Words, rays: int) -> Array:
    """Return unit directions around normals, (n, rays, 3), as dense as their cosine."""
    k = np.arange(rays, dtype=np.uint64)
    u = (k + uniform(mixed(seeds[:, None] + k))) / rays
    angle = 2.0 * np.pi * uniform(seeds[:, None] + k * np.uint64(_GOLDEN))
    x, y = _beside(normals)
    parts = np.sqrt(u) * np.cos(angle), np.sqrt(u) * np.sin(angle), np.sqrt(1.0 - u)
    axes = x, y, normals
    pairs = zip(parts, axes, strict=True)
    ways: Array = np.sum([part[..., None] * axis[:, None] for part, axis in pairs], axis=0)
    return ways


def mixed(words: Words) -> Words:
    """Hash numbers, as SplitMix64 does."""
    x = words + np.uint64(_GOLDEN)
    for shift, factor in ((30, 0xBF58476D1CE4E5B9), (27, 0x94D049BB133111EB)):
        x = (x ^ (x >> np.uint64(shift))) * np.uint64(factor)
    return x ^ (x >> np.uint64(31))


def uniform(words: Words) -> Array:
    """Return numbers in [0, 1), by the upper 53 bits."""
    return (words >> np.uint64(11)).astype(np.float64) / 2.0**53


def _beside(normals: Array) -> tuple[Array, Array]:
    """Return two axes beside each unit normal: where x and y come as z is turned to it.

    It is turned about what is at right angles to both (Rodrigues). A normal that looks down is
    turned round for that, and y afterwards.
    """
    sign = np.where(np.signbit(normals[:, 2]), -1.0, 1.0)
    up = sign[:, None] * normals
    shared = 1.0 / (1.0 + up[:, 2])
    first = np.stack([1.0 - up[:, 0] ** 2 * shared, -up[:, 0] * up[:, 1] * shared, -up[:, 0]], -1)
    second = np.stack([-up[:, 0] * up[:, 1] * shared, 1.0 - up[:, 1] ** 2 * shared, -up[:, 1]], -1)
    return first, second * sign[:, None]
