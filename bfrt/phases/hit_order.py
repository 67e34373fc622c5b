"""Hits in the order of their objects, of which only those that are hit are read (the paper's
refinement G)."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bfrt.ids import index_of, object_id, stream_of
from bfrt.records import NO_HIT, plain
from bfrt.scan.scans import GroupScans
from bfrt.scan.sources import PickedObjects
from bfrt.store.stream import Stream
from bfrt.streams.bucket_sort import buckets_of, gathered
from bfrt.streams.spool import Spool


def hits_of(ids: NDArray[np.uint64], stream: Stream) -> slice:
    """Find the hits on a stream's objects among ascending ids."""
    numbers = np.array([object_id(stream.number, 0), object_id(stream.number + 1, 0)], np.uint64)
    begin, end = np.searchsorted(ids, numbers)
    return slice(int(begin), int(end))


def picked(
    scans: GroupScans, stream: Stream, ids: NDArray[np.uint64]
) -> tuple[PickedObjects, NDArray[np.int64]]:
    """Return the source of the objects that are hit, and where each one's hits begin.

    Parameters
    ----------
    ids : (hits,) uint64
        The objects that are hit, ascending; all in the stream, one or more.

    Returns
    -------
    source : PickedObjects
    starts : (objects + 1,) int64
        Where each object's hits begin, and the end of the last.
    """
    own = index_of(ids).astype(np.int64)
    starts = np.flatnonzero(np.diff(own, prepend=-1))
    return PickedObjects(scans, stream, own[starts]), np.append(starts, len(own))


def by_object(
    hits: Spool, groups: list[GroupScans], room: int
) -> Iterator[tuple[NDArray[Any], bool]]:
    """Yield all hits of a spool, `room` at most at once, in the order of their objects.

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
    streams = [stream for scans in groups for stream in scans.streams]
    further = (len(hits) - 1) // room
    swept = further * sum(stream.expected_bytes()["geometry"] for stream in streams)
    moved = 2 * len(hits) * hits.dtype.itemsize
    parts: Iterable[Spool] = (hits,)
    if swept > moved and all(scans.lazy for scans in groups):
        counts = np.zeros(1 + max(stream.number for stream in streams), np.int64)
        counts[[stream.number for stream in streams]] = [stream.count for stream in streams]
        ends = np.cumsum(counts)
        parts = buckets_of(
            hits, partial(_places, begins=ends - counts), 0, int(ends[-1]), room, once=True
        )
    load = np.empty(min(room, len(hits)), hits.dtype)
    for part in parts:
        while len(part):
            n = _sort(gathered(part, room), load)
            begins, reached = bool(load["id"][0] < reached), load["id"][n - 1]
            yield load[:n], begins


def _sort(hits: NDArray[Any], load: NDArray[Any]) -> int:
    """Put hits into `load` by object; return how many."""
    n = len(hits)
    # Without the mode NumPy makes one more copy.
    plain(hits).take(np.argsort(hits["id"]), out=plain(load[:n]), mode="clip")
    return n


def _places(hits: NDArray[Any], begins: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return the index of each hit's object among the objects of all streams."""
    ids = hits["id"]
    places: NDArray[np.int64] = begins[stream_of(ids)] + index_of(ids).astype(np.int64)
    return places
