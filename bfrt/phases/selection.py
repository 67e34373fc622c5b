"""Which objects a pass has to look at: all of them, or those below the boxes of the hierarchy
that are near what the pass is about."""

from __future__ import annotations

import threading
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from bfrt.geometry.lattice import Lattice
from bfrt.phases._selection import Selection
from bfrt.phases.subspace import Subspace
from bfrt.phases.voxel_rays import VoxelRays
from bfrt.stats import Phase
from bfrt.store.objects import FEWEST, Choose, End, Objects
from bfrt.store.store import Store, Stream
from bfrt.store.sweep import Sweep
from bfrt.workers import chunk_of

#: Bytes of a level's read buffer.
LEVEL_BUFFER = 1 << 16

#: Objects that a thread takes at once, about, and at the most: where many rays are, few objects are
#: much work.
TOGETHER = 16384

#: Ranges that are chosen ahead, and have their boxes asked for; and objects, about as many as those
#: have where a parent has sixteen.
AHEAD = 8192
AHEAD_OBJECTS = 1 << 17

#: Of the objects from a batch's first to its last: with so many of them chosen their boxes are read
#: in order, which costs the system half as much a byte as what it is asked for.
DENSE = 0.75

#: A range and the box around its objects.
CHOSEN_BYTES = 2 * 8 + 6 * 4

#: The boxes (n, 6) around the objects of ranges.
Parents = NDArray[np.float32]

#: Called with a worker's number, its sweep, and ranges (n, 2) of its objects, ascending; and with
#: their parents, where the objects' boxes are quantised in these.
Loop = Callable[[int, Sweep, NDArray[np.int64], "Parents | None"], None]

#: Called with ranges whose boxes will be read.
Ask = Callable[[NDArray[np.int64]], None]

#: What objects are near: the voxels that hold rays, or those of a subspace.
Where = VoxelRays | Subspace


class Batch:
    """Ranges of objects that were chosen together.

    Attributes
    ----------
    ready : threading.Lock
        Held while they are being chosen.
    asked : bool
        Whether their boxes are asked for, for they lie apart.
    """

    def __init__(self) -> None:
        self.ready = threading.Lock()
        self._ranges = np.empty((AHEAD, 2), np.int64)
        self._parents = np.empty((AHEAD, 6), np.float32)
        self.clear()

    def clear(self) -> None:
        """Have none."""
        self.asked = False
        self._taken = 0
        self._ends = np.zeros(1, np.int64)

    @property
    def left(self) -> bool:
        """Whether there are ranges that were not taken."""
        return self._taken < len(self._ends) - 1

    def fill(
        self, walk: Selection, lattice: Lattice, where: Where, objects: int, coded: bool
    ) -> NDArray[np.int64]:
        """Choose the next ranges, of about so many objects; returns them."""
        self.clear()
        parents = self._parents if coded else None
        n = walk.select(lattice, where, self._ranges, objects, parents)
        ranges: NDArray[np.int64] = self._ranges[:n]
        self._ends = np.append(0, np.cumsum(ranges[:, 1] - ranges[:, 0]))
        self.asked = n > 0 and bool(self._ends[-1] < DENSE * (ranges[-1, 1] - ranges[0, 0]))
        return ranges

    def take(
        self, objects: int, ranges: NDArray[np.int64], parents: NDArray[np.float32]
    ) -> NDArray[np.int64]:
        """Copy the next ranges, of so many objects or a few more, with their parents; returns
        them."""
        first = self._taken
        wanted = self._ends[first] + objects
        self._taken = min(len(self._ends) - 1, int(np.searchsorted(self._ends, wanted)))
        n = self._taken - first
        ranges[:n] = self._ranges[first : self._taken]
        parents[:n] = self._parents[first : self._taken]
        return ranges[:n]


class Selections:
    """The walks down the hierarchies of a group's streams.

    Attributes
    ----------
    parents : (threads, AHEAD, 6) float32
        The boxes around the objects of the ranges that each worker took last.
    """

    def __init__(self, streams: list[Stream], threads: int) -> None:
        self._ranges = np.empty((threads, AHEAD, 2), np.int64)
        self.parents = np.empty((threads, AHEAD, 6), np.float32)
        self._batches = [Batch(), Batch()]
        self._walks = {s.number: Selection(s, LEVEL_BUFFER) for s in streams if s.levels}

    @staticmethod
    def bytes(store: Store, threads: int) -> int:
        """Bytes of the levels' read buffers, and of the ranges that are chosen ahead."""
        levels = sum(len(stream.levels) for stream in store.streams) * LEVEL_BUFFER
        return levels + len(store.groups) * (2 + threads) * AHEAD * CHOSEN_BYTES

    def begin(self, stream: Stream, lattice: Lattice, where: Where, ask: Ask) -> Choose:
        """Begin a stream's walk to the objects near `where`, which workers take in turns.

        While one batch of ranges is worked on, another is chosen, by the worker that came to the
        end of the one before, and its boxes are asked for, unless it is dense. The first are
        small, so that all workers soon have something to do. The ranges that a worker takes are
        the same memory each time, and so are their `parents`, which there are where boxes are
        quantised.
        """
        walk = self._walks[stream.number]
        objects = chunk_of(stream.count, len(self._ranges), FEWEST, TOGETHER)
        size = objects * len(self._ranges) // 2
        turn = threading.Lock()
        now, following = self._batches

        def fill(batch: Batch) -> None:
            nonlocal size
            size = min(2 * size, AHEAD_OBJECTS)
            ranges = batch.fill(walk, lattice, where, size, stream.quantised)
            if batch.asked:
                ask(ranges)

        def choose(worker: int) -> tuple[NDArray[np.int64], bool]:
            nonlocal now, following
            to_fill = None
            with turn:
                if not now.left:
                    with following.ready:
                        now, following = following, now
                    following.clear()
                    to_fill = following if now.left else None
                taken = now.take(objects, self._ranges[worker], self.parents[worker])
                asked = now.asked
                if to_fill is not None:
                    to_fill.ready.acquire()
            if to_fill is not None:
                try:
                    fill(to_fill)
                finally:
                    to_fill.ready.release()
            return taken, asked

        walk.rewind()
        now.clear()
        fill(following)
        return choose

    def count(self, phase: Phase) -> int:
        """Take over what walks have read; returns the boxes."""
        counts = [walk.counts_read() for walk in self._walks.values()]
        phase.bytes_read += sum(c[1] for c in counts)
        phase.seeks += sum(c[2] for c in counts)
        return sum(c[0] for c in counts)


def sweep_all(objects: Objects, loop: Loop, end: End | None = None) -> int:
    """One pass over all objects; returns how many they are."""

    def whole(worker: int, sweep: Sweep, first: int, last: int) -> None:
        loop(worker, sweep, np.array([[first, last]]), None)

    for stream in objects.group.streams:
        objects.sweep(stream, whole)
        if end is not None:
            objects.end(stream, end)
    return sum(stream.count for stream in objects.group.streams)


def sweep_near(
    objects: Objects,
    selections: Selections,
    lattice: Lattice,
    where: Where,
    loop: Loop,
    end: End | None = None,
) -> int:
    """One pass over the objects near `where`, by their quantised boxes if there are any; returns
    how many they are."""
    swept = 0
    for stream in objects.group.streams:
        if not stream.levels:  # there are no objects
            continue
        coded = stream.quantised

        def meet(worker: int, sweep: Sweep, ranges: NDArray[np.int64], coded: bool = coded) -> None:
            parents = selections.parents[worker, : len(ranges)] if coded else None
            loop(worker, sweep, ranges, parents)

        ask = objects.begin_chosen(stream)
        swept += objects.chosen(stream, selections.begin(stream, lattice, where, ask), meet)
        if end is not None:
            objects.end(stream, end)
    return swept
