"""Hits in the order of their objects, of which only those that are hit are read (the paper's
refinement G)."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bfrt.records import INDEX_BITS, NO_HIT, plain
from bfrt.store.objects import Objects
from bfrt.store.sweep import Sweep
from bfrt.streams.parting import gathered, parted
from bfrt.streams.spool import Spool

#: Objects that are hit, of which a thread asks for so many at once: up to 16 KB of the page cache
#: each.
PICKED = 512

#: Called with a worker's number, its sweep, and the hits [first, last) on objects that it picks.
Pick = Callable[[int, Sweep, int, int], None]


def each_hit(objects: Objects, ids: NDArray[np.uint64], pick: Pick) -> None:
    """Call `pick` for all hits on a group's objects, by threads, those of an object together.

    Parameters
    ----------
    ids : (hits,) uint64
        The objects that are hit, ascending.
    """
    for stream in objects.group.streams:
        numbers = np.array([stream.number, stream.number + 1], np.uint64) << np.uint64(INDEX_BITS)
        begin, end = np.searchsorted(ids, numbers)
        own = (ids[begin:end] - numbers[0]).astype(np.int64)
        starts = np.flatnonzero(np.diff(own, prepend=-1))  # of each object's hits
        ranges = own[starts, None] + np.array([0, 1])
        starts = np.append(starts, len(own)) + begin

        def some(
            worker: int,
            sweep: Sweep,
            a: int,
            b: int,
            starts: NDArray[np.int64] = starts,
        ) -> None:
            pick(worker, sweep, int(starts[a]), int(starts[b]))

        if len(ranges):
            objects.pick(stream, ranges, some, together=PICKED)


def by_object(hits: Spool, groups: list[Objects], room: int) -> Iterator[tuple[NDArray[Any], bool]]:
    """All hits of a spool, `room` at the most at once, in the order of their objects.

    The paper sorts what fills memory, and sweeps for each such load. Where reading all geometry
    for every further load takes more bytes than parting the hits by object first, which writes
    and reads them once more, these are parted: loads are then in order too, but for a crowd on few
    objects, and one sweep is read in all. Without lazy geometry every load is a sweep in any case.

    Yields
    ------
    hits : ndarray
        The same memory each time.
    begins : bool
        Whether a sweep begins with them, or goes on.
    """
    reached = np.uint64(NO_HIT)
    streams = [stream for objects in groups for stream in objects.group.streams]
    further = (len(hits) - 1) // room
    swept = further * sum(stream.expected_bytes()["geometry"] for stream in streams)
    moved = 2 * len(hits) * hits.dtype.itemsize
    parts: Iterable[Spool] = (hits,)
    if swept > moved and all(objects.lazy for objects in groups):
        counts = np.zeros(1 + max(stream.number for stream in streams), np.int64)
        counts[[stream.number for stream in streams]] = [stream.count for stream in streams]
        ends = np.cumsum(counts)
        parts = parted(
            hits, partial(_places, begins=ends - counts), 0, int(ends[-1]), room, once=True
        )
    load = np.empty(min(room, len(hits)), hits.dtype)
    for part in parts:
        while len(part):
            n = _sort(gathered(part, room), load)
            begins, reached = bool(load["id"][0] < reached), load["id"][n - 1]
            yield load[:n], begins


def _sort(hits: NDArray[Any], load: NDArray[Any]) -> int:
    """Put hits into `load` by object; returns how many."""
    n = len(hits)
    # Without the mode NumPy makes one more copy.
    plain(hits).take(np.argsort(hits["id"]), out=plain(load[:n]), mode="clip")
    return n


def _places(hits: NDArray[Any], begins: NDArray[np.int64]) -> NDArray[np.int64]:
    """Where the hits' objects are among those of all streams."""
    ids = hits["id"].astype(np.int64)
    places: NDArray[np.int64] = begins[ids >> INDEX_BITS] + (ids & ((1 << INDEX_BITS) - 1))
    return places
