"""Hits in the order of their objects, of which only those that are hit are read (the paper's
refinement G)."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bfrt.ids import index_of, object_id, stream_of
from bfrt.records import NO_HIT, plain
from bfrt.scan.scans import GroupScans
from bfrt.scan.sources import PickedObjects
from bfrt.store.stream import Stream
from bfrt.streams.bucket_sort import gathered, parted
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


class HitLoads:
    """Iterates over all hits of a spool, some at once, in the order of their objects.

    The paper sorts what fills memory, and sweeps for each such load. Where reading all geometry
    for every further load takes more bytes than parting the hits by object first, which writes
    and reads them once more, these are parted: loads are then in order too, but for a crowd on few
    objects, and one sweep is read in all. Without lazy geometry every load is a sweep in any case.

    Each load is an array of hits, the same memory each time, and whether a sweep begins with them,
    or goes on.

    Parameters
    ----------
    hits : Spool
    groups : list of GroupScans
    room : int
        Hits at once, at the most.
    """

    def __init__(self, hits: Spool, groups: list[GroupScans], room: int) -> None:
        self._hits = hits
        self._groups = groups
        self._room = room
        self._parts = [hits]

    def __len__(self) -> int:
        """Return the number of hits that are still to come."""
        return sum(len(part) for part in self._parts)

    def waiting(self) -> Iterator[NDArray[Any]]:
        """Yield the hits that are still to come, in any order, and leave them."""
        for part in self._parts:
            yield from part.waiting()

    def __iter__(self) -> Iterator[tuple[NDArray[Any], bool]]:
        hits, room = self._hits, self._room
        reached = np.uint64(NO_HIT)
        load = np.empty(min(room, len(hits)), hits.dtype)
        parts = self._parts = self._parted()
        try:
            for part in parts:
                while len(part):
                    n = _sort(gathered(part, room), load)
                    begins, reached = bool(load["id"][0] < reached), load["id"][n - 1]
                    yield load[:n], begins
                if part is not hits:
                    part.clear()
        finally:
            for part in parts:
                if part is not hits:
                    part.close()

    def _parted(self) -> list[Spool]:
        """Return the hits in spools by their objects, where that saves reading; or as they are."""
        hits, room = self._hits, self._room
        streams = [stream for scans in self._groups for stream in scans.streams]
        further = (len(hits) - 1) // room
        swept = further * sum(stream.expected_bytes()["geometry"] for stream in streams)
        moved = 2 * len(hits) * hits.dtype.itemsize
        if swept <= moved or not all(scans.lazy for scans in self._groups):
            return [hits]
        counts = np.zeros(1 + max(stream.number for stream in streams), np.int64)
        counts[[stream.number for stream in streams]] = [stream.count for stream in streams]
        ends = np.cumsum(counts)
        return parted(hits, partial(_places, begins=ends - counts), 0, int(ends[-1]), room)


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
