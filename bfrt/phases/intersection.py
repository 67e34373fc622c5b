"""Intersection: one sweep over the objects, each against the rays in its voxels.

The paper's inner loop, ``for (each object on disk)``: the roles of rays and objects are switched,
rays stay and objects stream past. With the hierarchy only those stream past whose parents are
near rays.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from bfrt.phases._intersection import intersect
from bfrt.phases._selection import Selection
from bfrt.phases.traversal import Flight
from bfrt.phases.voxel_rays import VoxelRays
from bfrt.scene.objects import Objects
from bfrt.scene.store import Stream
from bfrt.scene.sweep import Sweep
from bfrt.stats import Counters, Phase

#: Ranges of objects that are selected at once, and bytes of a level's read buffer.
SELECTED = 16384
LEVEL_BUFFER = 1 << 16

#: Objects that a thread takes at once, about: where many rays are, few objects are much work.
TOGETHER = 2048


class Selections:
    """The walks down the hierarchies of a group's streams."""

    def __init__(self, streams: list[Stream]) -> None:
        self._ranges = np.empty((SELECTED, 2), np.int64)
        self._walks = {s.number: Selection(s, LEVEL_BUFFER) for s in streams if s.levels}

    def of(
        self, stream: Stream, flight: Flight, voxel_rays: VoxelRays
    ) -> Iterator[NDArray[np.int64]]:
        """Ranges (n, 2) of the objects near rays, ascending; each array is the same memory."""
        walk = self._walks.get(stream.number)
        if walk is None:  # there are no objects
            return
        walk.rewind()
        while n := walk.select(flight.lattice, voxel_rays, self._ranges):
            yield self._ranges[:n]

    def count(self, phase: Phase) -> int:
        """Take over what walks have read; returns the boxes."""
        counts = [walk.counts_read() for walk in self._walks.values()]
        phase.bytes_read += sum(c[1] for c in counts)
        phase.seeks += sum(c[2] for c in counts)
        return sum(c[0] for c in counts)


def intersect_all(
    objects: Objects,
    selections: Selections | None,
    flight: Flight,
    voxel_rays: VoxelRays,
    counters: Counters,
) -> int:
    """Update the nearest hit of every ray that is stored in a voxel.

    Parameters
    ----------
    selections : Selections, optional
        Without, all objects are swept.

    Returns
    -------
    int
        Objects swept.
    """
    rays = flight.rays
    tallies: list[tuple[int, int]] = []

    def meet(sweep: Sweep, ranges: NDArray[np.int64]) -> None:
        tallies.append(intersect(sweep, ranges, flight.lattice, voxel_rays, rays))

    def loop(_: int, sweep: Sweep, first: int, last: int) -> None:
        meet(sweep, np.array([[first, last]]))

    if selections is None:
        swept = objects.each(loop)
        boxes = swept
    else:
        swept = 0
        for stream in objects.group.streams:
            objects.begin(stream)
            for ranges in selections.of(stream, flight, voxel_rays):
                found = int((ranges[:, 1] - ranges[:, 0]).sum())
                swept += found
                together = max(1, TOGETHER * len(ranges) // found)

                def some(
                    _: int, sweep: Sweep, a: int, b: int, ranges: NDArray[np.int64] = ranges
                ) -> None:
                    meet(sweep, ranges[a:b])

                objects.some(stream, ranges, some, together=together)
        boxes = swept + selections.count(counters.phases.intersection)
    counters.sweep(boxes, objects)
    counters.phases.intersection.swept(objects)
    for box_tests, object_tests in tallies:
        counters.box_tests += box_tests
        counters.object_tests += object_tests
    return swept
