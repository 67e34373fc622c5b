"""Which objects a pass has to look at: all of them, or those below the boxes of the hierarchy
that are near what the pass is about."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np
from numpy.typing import NDArray

from bfrt.geometry.lattice import Lattice
from bfrt.phases._selection import Selection
from bfrt.phases.subspace import Subspace
from bfrt.phases.voxel_rays import VoxelRays
from bfrt.scene.objects import Objects
from bfrt.scene.store import Stream
from bfrt.scene.sweep import Sweep
from bfrt.stats import Phase

#: Ranges of objects that are selected at once, and bytes of a level's read buffer.
SELECTED = 16384
LEVEL_BUFFER = 1 << 16

#: Objects that a thread takes at once, about: where many rays are, few objects are much work.
TOGETHER = 2048

#: The boxes (n, 6) around the objects of ranges.
Parents = NDArray[np.float32]

#: Called with a sweep and ranges (n, 2) of its objects, ascending; and with their parents, where
#: the objects' boxes are quantised in these.
Loop = Callable[[Sweep, NDArray[np.int64], "Parents | None"], None]

#: What objects are near: the voxels that hold rays, or those of a subspace.
Where = VoxelRays | Subspace


class Selections:
    """The walks down the hierarchies of a group's streams."""

    def __init__(self, streams: list[Stream]) -> None:
        self._ranges = np.empty((SELECTED, 2), np.int64)
        self._parents = np.empty((SELECTED, 6), np.float32)
        self._walks = {s.number: Selection(s, LEVEL_BUFFER) for s in streams if s.levels}

    def of(
        self, stream: Stream, lattice: Lattice, where: Where, quantised: bool
    ) -> Iterator[tuple[NDArray[np.int64], Parents | None]]:
        """Ranges (n, 2) of the objects near `where`, ascending, with their parents where boxes are
        `quantised`; each array is the same memory."""
        walk = self._walks.get(stream.number)
        if walk is None:  # there are no objects
            return
        walk.rewind()
        parents = self._parents if quantised else None
        while n := walk.select(lattice, where, self._ranges, parents):
            yield self._ranges[:n], None if parents is None else parents[:n]

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
    *,
    quantised: bool,
) -> int:
    """One pass over the objects near `where`, by their quantised boxes if there are any and that
    will do; returns how many they are."""
    swept = 0
    for stream in objects.group.streams:
        objects.begin(stream)
        coded = quantised and stream.quantised
        for ranges, parents in selections.of(stream, lattice, where, coded):
            found = int((ranges[:, 1] - ranges[:, 0]).sum())
            swept += found
            together = max(1, TOGETHER * len(ranges) // found)

            def some(
                _: int,
                sweep: Sweep,
                a: int,
                b: int,
                ranges: NDArray[np.int64] = ranges,
                parents: Parents | None = parents,
            ) -> None:
                loop(sweep, ranges[a:b], None if parents is None else parents[a:b])

            objects.some(stream, ranges, some, together=together)
    return swept
