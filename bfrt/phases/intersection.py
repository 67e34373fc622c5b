"""Intersection: one sweep over the objects, each against the rays in its voxels.

The paper's inner loop, ``for (each object on disk)``: the roles of rays and objects are switched,
rays stay and objects stream past.
"""

from __future__ import annotations

from bfrt.phases._intersection import intersect
from bfrt.phases.traversal import Flight
from bfrt.phases.voxel_rays import VoxelRays
from bfrt.scene.objects import Objects
from bfrt.scene.sweep import Sweep
from bfrt.stats import Counters


def intersect_all(
    objects: Objects,
    flight: Flight,
    voxel_rays: VoxelRays,
    counters: Counters,
) -> None:
    """Update the nearest hit of every ray that is stored in a voxel."""
    rays = flight.rays
    tallies: list[tuple[int, int]] = []

    def loop(_: int, sweep: Sweep, first: int, last: int) -> None:
        tallies.append(intersect(sweep, last - first, flight.lattice, voxel_rays, rays))

    counters.sweep(objects.each(loop))
    counters.phases.intersection.swept(objects)
    for box_tests, object_tests in tallies:
        counters.box_tests += box_tests
        counters.object_tests += object_tests
