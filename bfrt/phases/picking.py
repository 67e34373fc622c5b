"""Hits in the order of their objects, of which only those that are hit are read (the paper's
refinement G)."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bfrt.records import INDEX_BITS, plain
from bfrt.scene.objects import Objects
from bfrt.scene.sweep import Sweep

#: Objects that are hit, of which a thread takes so many at once.
PICKED = 2048

#: Called with a worker's number, its sweep, and the hits [first, last) on objects in its window.
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
            ranges: NDArray[np.int64] = ranges,
        ) -> None:
            sweep.material_window(int(ranges[a, 0]), int(ranges[b - 1, 1]))
            pick(worker, sweep, int(starts[a]), int(starts[b]))

        objects.begin(stream)
        objects.some(stream, ranges, some, together=PICKED)


def gathered(hits: Any, room: int) -> NDArray[Any]:
    """Records of a spool that fill memory: `room` at the most."""
    parts = []
    while len(hits) and room:
        parts.append(hits.read(room))
        room -= len(parts[-1])
    return parts[0] if len(parts) == 1 else np.concatenate(parts)


def by_object(hits: Any, room: int) -> NDArray[Any]:
    """The next hits of a spool, `room` at the most, in the order of their objects."""
    some = gathered(hits, room)
    return plain(some)[np.argsort(some["id"])].view(some.dtype)
