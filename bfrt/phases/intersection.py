"""Intersection: one sweep over the objects, each against the rays in its voxels.

The paper's inner loop, ``for (each object on disk)``: the roles of rays and objects are switched,
rays stay and objects stream past. With the hierarchy only those stream past whose parents are
near rays.
"""

from __future__ import annotations

from bfrt.grid.selection import Selection
from bfrt.phases._intersection import Intersector
from bfrt.phases.traversal import Flight
from bfrt.scan.scan import StreamScan
from bfrt.scan.scans import GroupScans
from bfrt.scan.sources import Chunk
from bfrt.stats import Counters
from bfrt.workers import Workers


def intersect_all(
    scans: GroupScans,
    selection: Selection,
    flight: Flight,
    intersectors: list[Intersector],
    workers: Workers,
    counters: Counters,
) -> int:
    """Update the nearest hit of every ray that is stored in a voxel, or find all.

    Returns
    -------
    int
        Objects swept.
    """
    for intersector in intersectors:
        flight.hand(intersector)

    def meet(worker: int, chunk: Chunk) -> None:
        intersectors[worker].meet(*chunk)

    swept = 0
    for stream in scans.streams:
        source = selection.near(stream, flight.grid, flight.voxel_rays)
        workers.drain(source, meet)
        finish_all(intersectors, scans.of(stream), workers)
        swept += source.swept
    phase = counters.phases.intersection
    counters.sweep(swept + selection.count(phase), scans)
    phase.swept(scans)
    for intersector in intersectors:
        box_tests, object_tests = intersector.tests()
        counters.box_tests += box_tests
        counters.object_tests += object_tests
    return swept


def finish_all(intersectors: list[Intersector], scans: list[StreamScan], workers: Workers) -> None:
    """Settle the rays that still wait for the geometry of a stream."""
    workers.each(lambda worker: intersectors[worker].finish(scans[worker]))
