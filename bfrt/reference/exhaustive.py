"""The slow twin: every ray against every object of a store, by the core's own kernels.

::

    fast path    grid, marks, candidates, passes, culling ─┐
                                                           ├─ the same (t, id), bit for bit
    this one     for each object: for each ray ────────────┘

It shares with the fast path what decides a hit (the kernels, and exactness rule 1: a hit counts
within the slab interval of the object's box padded by d) and nothing of what skips work: no grid,
no marks, no boxes from disk, no culling by the nearest hit so far. `bfrt.reference.independent` in
its turn shares no formula with the kernels.

Rays are taken by chunks, for each of which the objects stream past once: memory is bounded, but
for the caller's own arrays.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from bfrt.errors import SettingError
from bfrt.ids import object_id
from bfrt.phases.preprocess import padding_of
from bfrt.records import NO_HIT
from bfrt.reference._exhaustive import (
    LINE_DOUBLES,
    bring_near,
    cross,
    lines,
    meet,
    scale_directions,
)
from bfrt.scan.files import StreamFiles
from bfrt.scan.geometry import GeometryCursor
from bfrt.scan.scans import READ_BUFFER
from bfrt.store.store import Store
from bfrt.store.stream import Stream
from bfrt.workers import Workers

Array = NDArray[np.float64]
Ids = NDArray[np.uint64]

RAYS = 4096  # rays that a worker sweeps the objects for


def nearest(
    store: Store,
    origins: ArrayLike,
    directions: ArrayLike,
    t_max: ArrayLike = np.inf,
    *,
    threads: int = 1,
) -> tuple[Array, Ids]:
    """Find the nearest hit of each ray: the least (t, id) over all objects.

    Parameters
    ----------
    store : Store
    origins, directions : (n, 3)
        The rays, relative to the store's origin; directions of any length but zero.
    t_max : float or (n,)
        Hits are nearer than this.
    threads : int
        It changes no bit of the answer.

    Returns
    -------
    t : (n,) float64
        In lengths of the direction; inf for a miss.
    id : (n,) uint64
        ``stream << 48 | index``; NO_HIT for a miss. A ray with a NaN, or of zero length, misses.

    Raises
    ------
    SettingError
        If origins and directions are not of one shape (n, 3).
    """
    start, way = _rays(origins, directions)
    t = np.full(len(start), np.inf)
    ids = np.full(len(start), NO_HIT, np.uint64)
    padding = padding_of(store)
    objects = {stream.number: ids_of(stream) for stream in store.streams}
    cursors = [[cursor_of(store, stream) for stream in store.streams] for _ in range(threads)]

    def chunk(worker: int, first: int, last: int) -> None:
        part = slice(first, last)
        along, powers = scaled(way[part])
        near, moved = advanced(store, start[part], along)
        rays = np.empty((last - first, LINE_DOUBLES))
        lines(near, along, rays)
        for stream, cursor in zip(store.streams, cursors[worker], strict=True):
            cursor.rewind()
            cursor.window(0, stream.count)
            meet(cursor, objects[stream.number], padding, rays, t[part], ids[part])
        t[part] = lengths(t[part] + moved, powers)  # only now: rounded, two hits might tie

    workers = Workers(threads)
    try:
        workers.run(chunk, len(start), largest=RAYS)
    finally:
        workers.close()
    beyond = ~(t < np.asarray(t_max, np.float64))
    t[beyond] = np.inf
    ids[beyond] = NO_HIT
    return t, ids


def occluded(
    store: Store,
    origins: ArrayLike,
    directions: ArrayLike,
    t_max: ArrayLike = np.inf,
    *,
    threads: int = 1,
) -> NDArray[np.bool_]:
    """Tell for each ray, (n,), whether it hits anything before `t_max`; else as `nearest`."""
    dark: NDArray[np.bool_] = np.isfinite(
        nearest(store, origins, directions, t_max, threads=threads)[0]
    )
    return dark


def crossings(
    store: Store, origins: ArrayLike, directions: ArrayLike, t_max: ArrayLike = np.inf
) -> tuple[NDArray[np.int64], Array, Ids]:
    """Find all hits of each ray, ordered by ray, t and id; all else as for `nearest`.

    Returns
    -------
    ray : (m,) int64
    t : (m,) float64
    id : (m,) uint64
    """
    start, way = _rays(origins, directions)
    way, powers = scaled(way)
    near, moved = advanced(store, start, way)
    rays = np.empty((len(start), LINE_DOUBLES))
    lines(near, way, rays)
    found: list[tuple[int, float, int]] = []
    for stream in store.streams:
        cursor = cursor_of(store, stream)
        cursor.window(0, stream.count)
        cross(cursor, ids_of(stream), padding_of(store), rays, found)
    ray = np.array([f[0] for f in found], np.int64)
    t = lengths(np.array([f[1] for f in found], np.float64) + moved[ray], powers[ray])
    ids = np.array([f[2] for f in found], np.uint64)
    order = np.lexsort((ids, t, ray))
    before = order[(t < np.broadcast_to(np.asarray(t_max, np.float64), len(start))[ray])[order]]
    return ray[before], t[before], ids[before]


def scaled(directions: ArrayLike) -> tuple[Array, NDArray[np.int32]]:
    """Divide extreme directions of (n, 3) by powers of two; return all, and the powers (n,)."""
    way = np.array(directions, np.float64)
    powers = np.zeros(len(way), np.int32)
    scale_directions(way, powers)
    return way, powers


def lengths(t: Array, powers: NDArray[np.int32]) -> Array:
    """Return t (n,) in lengths of the directions before they were divided by powers of two."""
    with np.errstate(over="ignore"):  # then it is no number, and a miss
        return np.ldexp(t, -powers)


def ids_of(stream: Stream) -> NDArray[np.uint64]:
    """Return the ids of all objects of a stream, as they are stored."""
    if stream.ordered:
        places = stream.load("ids", f"<u{stream.id_bytes}").astype(np.uint64)
    else:
        places = np.arange(stream.count, dtype=np.uint64)
    return places | np.uint64(object_id(stream.number, 0))


def cursor_of(store: Store, stream: Stream) -> GeometryCursor:
    """Open a stream's geometry, to be read in order."""
    return GeometryCursor(stream, store.origin, StreamFiles(stream, lazy=False), READ_BUFFER)


def advanced(store: Store, origins: ArrayLike, directions: ArrayLike) -> tuple[Array, Array]:
    """Move rays that start far away nearer to the scene (exactness rule 6).

    Parameters
    ----------
    origins, directions : (n, 3)
        Relative to the store's origin.

    Returns
    -------
    origins : (n, 3)
        Origins that are near enough stay as they are. NaN for a ray that is none.
    moved : (n,)
        The t that belongs to each origin; to be added to that of a hit.
    """
    start, way = _rays(origins, directions)
    near = start.copy()
    moved = np.empty(len(start))
    if store.bounds.empty:
        return near, np.zeros(len(start))
    bounds = np.stack([store.bounds.lo, store.bounds.hi])
    bring_near(near, way, bounds, moved)
    return near, moved


def _rays(origins: ArrayLike, directions: ArrayLike) -> tuple[Array, Array]:
    start = np.ascontiguousarray(origins, np.float64)
    way = np.ascontiguousarray(directions, np.float64)
    if start.ndim != 2 or start.shape[1] != 3 or way.shape != start.shape:
        raise SettingError(
            f"rays: found origins {start.shape} and directions {way.shape}, "
            "expected (n, 3) for both"
        )
    return start, way
