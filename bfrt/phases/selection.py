"""Which objects a pass has to look at: all of them, or those below the boxes of the hierarchy
that are near what the pass is about."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from bfrt.geometry.lattice import Lattice
from bfrt.phases._selection import Selection
from bfrt.phases.subspace import Subspace
from bfrt.phases.voxel_rays import VoxelRays
from bfrt.scene.objects import FEWEST, Choose, Objects
from bfrt.scene.store import Stream
from bfrt.scene.sweep import Sweep
from bfrt.stats import Phase
from bfrt.workers import chunk_of

#: Bytes of a level's read buffer.
LEVEL_BUFFER = 1 << 16

#: Objects that a thread takes at once, about, and at the most: where many rays are, few objects are
#: much work.
TOGETHER = 4096

#: The boxes (n, 6) around the objects of ranges.
Parents = NDArray[np.float32]

#: Called with a sweep and ranges (n, 2) of its objects, ascending; and with their parents, where
#: the objects' boxes are quantised in these.
Loop = Callable[[Sweep, NDArray[np.int64], "Parents | None"], None]

#: What objects are near: the voxels that hold rays, or those of a subspace.
Where = VoxelRays | Subspace


class Selections:
    """The walks down the hierarchies of a group's streams.

    Attributes
    ----------
    parents : (threads, TOGETHER, 6) float32
        The boxes around the objects of the ranges that each worker chose last.
    """

    def __init__(self, streams: list[Stream], threads: int) -> None:
        self._ranges = np.empty((threads, TOGETHER, 2), np.int64)
        self.parents = np.empty((threads, TOGETHER, 6), np.float32)
        self._walks = {s.number: Selection(s, LEVEL_BUFFER) for s in streams if s.levels}

    def begin(self, stream: Stream, lattice: Lattice, where: Where) -> Choose:
        """Begin a stream's walk to the objects near `where`, which workers take in turns.

        The ranges that a worker chooses are the same memory each time, and so are their `parents`,
        which there are where boxes are quantised.
        """
        walk = self._walks[stream.number]
        walk.rewind()
        objects = chunk_of(stream.count, len(self._ranges), FEWEST, TOGETHER)

        def choose(worker: int) -> NDArray[np.int64]:
            ranges: NDArray[np.int64] = self._ranges[worker]
            parents = self.parents[worker] if stream.quantised else None
            return ranges[: walk.select(lattice, where, ranges, objects, parents)]

        return choose

    def count(self, phase: Phase) -> int:
        """Take over what walks have read; returns the boxes."""
        counts = [walk.counts_read() for walk in self._walks.values()]
        phase.bytes_read += sum(c[1] for c in counts)
        phase.seeks += sum(c[2] for c in counts)
        return sum(c[0] for c in counts)


def sweep_all(objects: Objects, loop: Loop) -> int:
    """One pass over all objects; returns how many they are."""

    def whole(_: int, sweep: Sweep, first: int, last: int) -> None:
        loop(sweep, np.array([[first, last]]), None)

    return objects.each(whole)


def sweep_near(
    objects: Objects,
    selections: Selections,
    lattice: Lattice,
    where: Where,
    loop: Loop,
) -> int:
    """One pass over the objects near `where`, by their quantised boxes if there are any; returns
    how many they are."""
    swept = 0
    for stream in objects.group.streams:
        if not stream.levels:  # there are no objects
            continue
        coded = stream.quantised

        def meet(worker: int, sweep: Sweep, ranges: NDArray[np.int64], coded: bool = coded) -> None:
            loop(sweep, ranges, selections.parents[worker, : len(ranges)] if coded else None)

        objects.begin(stream)
        swept += objects.chosen(stream, selections.begin(stream, lattice, where), meet)
    return swept
