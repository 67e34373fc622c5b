"""Sources of objects, from which workers get the next ones to look at.

A source belongs to one stream and one sweep. ``next(worker)`` sets the worker's scan to a chunk of
objects, behind those that it had, and returns the chunk, or None when there are no more. Chunks are
handed out in ascending order, so that each worker reads its files forwards.
"""

from __future__ import annotations

import itertools
import threading
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from bfrt.scan.scan import StreamScan
from bfrt.scan.scans import GroupScans
from bfrt.store.stream import Stream
from bfrt.workers import chunk_of

#: The fewest objects worth handing to a thread, and the most of a chunk in order.
FEWEST = 128
MOST = 8192

#: Chosen objects that a thread takes at once, about, and at the most: where many rays are, few
#: objects are much work.
TOGETHER = 16384

#: Ranges that are chosen ahead, and their boxes prefetched; and objects, about as many as those
#: have where a parent has sixteen.
AHEAD = 8192
AHEAD_OBJECTS = 1 << 17

#: Of the objects from a batch's first to its last: with so many of them chosen their boxes are read
#: in order, which costs the system half as much a byte as what is prefetched.
DENSE = 0.75

#: A range and the box around its objects.
CHOSEN_BYTES = 2 * 8 + 6 * 4

#: Picked objects, of which a thread prefetches so many at once: up to 16 KB of the page cache each;
#: and the fewest worth handing to one.
PICKED = 512
FEWEST_PICKED = 32

Ranges = NDArray[np.int64]
Parents = NDArray[np.float32]


class Chunk(NamedTuple):
    """Holds objects that a worker looks at together.

    Attributes
    ----------
    scan : StreamScan
        The worker's, set to the first of them.
    ranges : ndarray of int64, shape (n, 2)
        First and end of runs of objects, ascending.
    parents : ndarray of float32, shape (n, 6), optional
        The box around the objects of each run, where theirs are quantised.
    """

    scan: StreamScan
    ranges: Ranges
    parents: Parents | None = None


class Chooser(Protocol):
    """Finds ranges of a stream's objects, in order."""

    def choose(self, ranges: Ranges, objects: int, parents: Parents | None) -> int:
        """Fill in the next ranges, of about `objects` objects, and the boxes around each.

        Returns
        -------
        int
            Number of ranges; 0 at the end.
        """
        ...


class AllObjects:
    """Hands out all objects of a stream, in chunks.

    Attributes
    ----------
    swept : int
        Objects of the stream.
    """

    def __init__(self, scans: GroupScans, stream: Stream) -> None:
        self.swept = stream.count
        self._scans = scans.begin(stream, prefetched=False)
        self._count = stream.count
        self._chunk = chunk_of(stream.count, len(self._scans), FEWEST, MOST)
        self._starts = itertools.count(0, self._chunk)

    @property
    def short(self) -> bool:
        """Tell whether one worker is enough."""
        return self._count <= self._chunk

    def next(self, worker: int) -> Chunk | None:
        """Give a worker its next chunk."""
        first = next(self._starts)
        if first >= self._count:
            return None
        last = min(self._count, first + self._chunk)
        scan = self._scans[worker]
        self._set(scan, first, last)
        return Chunk(scan, np.array([[first, last]]))

    def _set(self, scan: StreamScan, first: int, last: int) -> None:
        scan.window(first, last)


class AllRecords(AllObjects):
    """Hands out geometry, materials and ids of all objects of a stream, and no boxes."""

    def _set(self, scan: StreamScan, first: int, last: int) -> None:
        scan.geometry.window(first, last)
        scan.materials.window(first, last)
        scan.ids.window(first, last)


class PickedObjects:
    """Hands out objects that are known one by one, whose geometry, materials and ids are read.

    Parameters
    ----------
    objects : (n,) int64
        Which ones, ascending.
    """

    def __init__(self, scans: GroupScans, stream: Stream, objects: NDArray[np.int64]) -> None:
        # Where everything is read in a pass, files are open for that way only.
        self._scans = scans.begin(stream, prefetched=scans.lazy)
        self._ranges = objects[:, None] + np.array([0, 1])
        self._chunk = chunk_of(len(objects), len(self._scans), FEWEST_PICKED, PICKED)
        self._starts = itertools.count(0, self._chunk)

    @property
    def short(self) -> bool:
        """Tell whether one worker is enough."""
        return len(self._ranges) <= self._chunk

    def next(self, worker: int) -> tuple[StreamScan, slice] | None:
        """Give a worker its scan, set to its next objects, and which of all these are."""
        first = next(self._starts)
        if first >= len(self._ranges):
            return None
        part = slice(first, min(len(self._ranges), first + self._chunk))
        scan = self._scans[worker]
        scan.pick(self._ranges[part])
        return scan, part


class Batch:
    """Holds ranges of objects that were chosen together.

    Attributes
    ----------
    ready : threading.Event
        Set when they are chosen.
    prefetched : bool
        Whether their boxes are prefetched, for they lie apart.
    """

    def __init__(self) -> None:
        self.ready = threading.Event()
        self._ranges = np.empty((AHEAD, 2), np.int64)
        self._parents = np.empty((AHEAD, 6), np.float32)
        self.clear()

    def clear(self) -> None:
        """Have none."""
        self.prefetched = False
        self._taken = 0
        self._ends = np.zeros(1, np.int64)

    @property
    def objects(self) -> int:
        """Return the number of objects in the ranges."""
        return int(self._ends[-1])

    @property
    def left(self) -> bool:
        """Tell whether there are ranges that were not taken."""
        return self._taken < len(self._ends) - 1

    def fill(self, chooser: Chooser, objects: int, coded: bool) -> Ranges:
        """Choose the next ranges, of about `objects` objects, and return them."""
        self.clear()
        n = chooser.choose(self._ranges, objects, self._parents if coded else None)
        ranges: Ranges = self._ranges[:n]
        self._ends = np.append(0, np.cumsum(ranges[:, 1] - ranges[:, 0]))
        self.prefetched = n > 0 and bool(self._ends[-1] < DENSE * (ranges[-1, 1] - ranges[0, 0]))
        return ranges

    def take(self, objects: int, ranges: Ranges, parents: Parents) -> int:
        """Copy the next ranges, of `objects` objects or a few more, with the boxes around each.

        Returns
        -------
        int
            Number of ranges.
        """
        first = self._taken
        end = self._ends[first] + objects
        self._taken = min(len(self._ends) - 1, int(np.searchsorted(self._ends, end)))
        n = self._taken - first
        ranges[:n] = self._ranges[first : self._taken]
        parents[:n] = self._parents[first : self._taken]
        return n


class Batches:
    """Holds the memory of one sweep's batches, and each worker's last chunk."""

    def __init__(self, threads: int) -> None:
        self.ranges = np.empty((threads, AHEAD, 2), np.int64)
        self.parents = np.empty((threads, AHEAD, 6), np.float32)
        self.two = (Batch(), Batch())

    @staticmethod
    def bytes(threads: int) -> int:
        """Return the bytes of the memory for a number of threads."""
        return (2 + threads) * AHEAD * CHOSEN_BYTES


class ChosenObjects:
    """Hands out the objects that a chooser finds, ahead of the workers.

    While one batch of ranges is worked on, another is chosen, by the worker that came to the end of
    the one before, and its boxes are prefetched, unless it is dense. The first are small, so that
    all workers soon have something to do. A worker's chunk is the same memory each time.

    Attributes
    ----------
    swept : int
        Objects handed out so far.
    short : bool
        Whether one worker is enough.
    """

    def __init__(
        self,
        scans: GroupScans,
        stream: Stream,
        chooser: Chooser,
        batches: Batches,
        fewest: int = FEWEST,
    ) -> None:
        self.swept = 0
        self._scans = scans.begin(stream, prefetched=True)
        self._chooser = chooser
        self._coded = stream.quantised
        self._memory = batches
        self._now, self._following = batches.two
        threads = len(self._scans)
        self._objects = chunk_of(stream.count, threads, min(fewest, TOGETHER), TOGETHER)
        self._size = self._objects * threads // 2
        self._turn = threading.Lock()
        self._now.clear()
        self._fill(self._following)
        found = self._following.objects
        self.short = found < self._size and found <= self._objects

    def _fill(self, batch: Batch) -> None:
        """Choose a batch, and prefetch its boxes."""
        self._size = min(2 * self._size, AHEAD_OBJECTS)
        try:
            ranges = batch.fill(self._chooser, self._size, self._coded)
            if batch.prefetched:
                self._scans[0].boxes.prefetch(ranges)
        finally:
            batch.ready.set()

    def next(self, worker: int) -> Chunk | None:
        """Give a worker its next chunk."""
        ranges, parents = self._memory.ranges[worker], self._memory.parents[worker]
        to_fill = None
        with self._turn:
            if not self._now.left:
                to_fill = self._turn_over()
            n = self._now.take(self._objects, ranges, parents)
            ranges = ranges[:n]
            prefetched = self._now.prefetched
            self.swept += int((ranges[:, 1] - ranges[:, 0]).sum())
        if to_fill is not None:
            self._fill(to_fill)
        if not n:
            return None
        scan = self._scans[worker]
        scan.boxes.choose(ranges, prefetched)
        return Chunk(scan, ranges, parents[:n] if self._coded else None)

    def _turn_over(self) -> Batch | None:
        """Go on to the batch that was chosen meanwhile; return the one that is to be filled."""
        self._following.ready.wait()
        self._now, self._following = self._following, self._now
        self._following.clear()
        if not self._now.left:
            return None
        self._following.ready.clear()
        return self._following
