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

#: Called with a sweep and ranges (n, 2) of its objects, ascending.
Loop = Callable[[Sweep, NDArray[np.int64]], None]

#: What objects are near: the voxels that hold rays, or those of a subspace.
Where = VoxelRays | Subspace


class Selections:
    """The walks down the hierarchies of a group's streams."""

    def __init__(self, streams: list[Stream]) -> None:
        self._ranges = np.empty((SELECTED, 2), np.int64)
        self._walks = {s.number: Selection(s, LEVEL_BUFFER) for s in streams if s.levels}

    def of(self, stream: Stream, lattice: Lattice, where: Where) -> Iterator[NDArray[np.int64]]:
        """Ranges (n, 2) of the objects near `where`, ascending; each array is the same memory."""
        walk = self._walks.get(stream.number)
        if walk is None:  # there are no objects
            return
        walk.rewind()
        while n := walk.select(lattice, where, self._ranges):
            yield self._ranges[:n]

    def count(self, phase: Phase) -> int:
        """Take over what walks have read; returns the boxes."""
        counts = [walk.counts_read() for walk in self._walks.values()]
        phase.bytes_read += sum(c[1] for c in counts)
        phase.seeks += sum(c[2] for c in counts)
        return sum(c[0] for c in counts)


def sweep_all(objects: Objects, loop: Loop) -> int:
    """One pass over all objects; returns how many they are."""

    def whole(_: int, sweep: Sweep, first: int, last: int) -> None:
        loop(sweep, np.array([[first, last]]))

    return objects.each(whole)


def sweep_near(
    objects: Objects, selections: Selections, lattice: Lattice, where: Where, loop: Loop
) -> int:
    """One pass over the objects near `where`; returns how many they are."""
    swept = 0
    for stream in objects.group.streams:
        objects.begin(stream)
        for ranges in selections.of(stream, lattice, where):
            found = int((ranges[:, 1] - ranges[:, 0]).sum())
            swept += found
            together = max(1, TOGETHER * len(ranges) // found)

            def some(
                _: int, sweep: Sweep, a: int, b: int, ranges: NDArray[np.int64] = ranges
            ) -> None:
                loop(sweep, ranges[a:b])

            objects.some(stream, ranges, some, together=together)
    return swept
