"""Intersection: one sweep over the objects, each against the rays in its voxels.

The paper's inner loop, ``for (each object on disk)``: the roles of rays and objects are switched,
rays stay and objects stream past. With the hierarchy only those stream past whose parents are
near rays.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from bfrt.phases._intersection import intersect, settle
from bfrt.phases.selection import Parents, Selections, sweep_all, sweep_near
from bfrt.phases.traversal import Flight
from bfrt.stats import Counters
from bfrt.store.objects import Objects
from bfrt.store.sweep import Sweep


def intersect_all(
    objects: Objects,
    selections: Selections | None,
    flight: Flight,
    counters: Counters,
) -> int:
    """Update the nearest hit of every ray that is stored in a voxel, or find all.

    Parameters
    ----------
    selections : Selections, optional
        Without, all objects are swept.

    Returns
    -------
    int
        Objects swept.
    """
    rays, voxel_rays = flight.rays, flight.voxel_rays
    tallies: list[tuple[int, int]] = []
    phase = counters.phases.intersection

    def crossings() -> tuple[Any, ...]:
        return () if flight.crossings is None else flight.crossings.buffer()

    def meet(worker: int, sweep: Sweep, ranges: NDArray[np.int64], parents: Parents | None) -> None:
        delays = flight.delays[worker]
        found = intersect(
            sweep, ranges, parents, delays, flight.lattice, voxel_rays, rays, *crossings()
        )
        tallies.append(found)

    def end(worker: int, sweep: Sweep) -> None:
        delays = flight.delays[worker]
        tallies.append((0, settle(sweep, delays, flight.lattice, rays, *crossings())))

    last = end if objects.lazy else None
    if selections is None:
        swept = boxes = sweep_all(objects, meet, last)
    else:
        swept = sweep_near(objects, selections, flight.lattice, voxel_rays, meet, last)
        boxes = swept + selections.count(phase)
    counters.sweep(boxes, objects)
    phase.swept(objects)
    for box_tests, object_tests in tallies:
        counters.box_tests += box_tests
        counters.object_tests += object_tests
    return swept
