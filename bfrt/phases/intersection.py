"""Intersection: one sweep over the objects, each against the rays in its voxels.

The paper's inner loop, ``for (each object on disk)``: the roles of rays and objects are switched,
rays stay and objects stream past. With the hierarchy only those stream past whose parents are
near rays.
"""

from __future__ import annotations

from collections.abc import Callable

from bfrt.grid.selection import Selection
from bfrt.phases._intersection import Intersector
from bfrt.phases.traversal import Traversal
from bfrt.scan.scan import StreamScan
from bfrt.scan.scans import GroupScans
from bfrt.scan.sources import FEWEST, Chunk
from bfrt.stats import Counters
from bfrt.workers import Workers, worth_handing


def intersect_all(
    scans: GroupScans,
    selection: Selection,
    traversal: Traversal,
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
        traversal.begin_pass(intersector)

    def meet(worker: int, chunk: Chunk) -> None:
        intersectors[worker].meet(*chunk)

    swept = 0
    for stream in scans.streams:
        fewest = max(FEWEST, worth_handing(stream.count, traversal.pool.stored))
        source = selection.near(stream, traversal.grid, traversal.voxel_rays, fewest)
        workers.drain(source, meet, finisher(intersectors, scans.of(stream)))
        swept += source.swept
    scans.order.check()
    phase = counters.phases.intersection
    counters.sweep(swept + selection.count(phase), scans)
    phase.swept(scans)
    for intersector in intersectors:
        box_tests, object_tests = intersector.tests()
        counters.box_tests += box_tests
        counters.object_tests += object_tests
    return swept


def finisher(intersectors: list[Intersector], scans: list[StreamScan]) -> Callable[[int], object]:
    """Return what tests the rays of a worker that still wait for the geometry of a stream."""

    def finish(worker: int) -> None:
        intersectors[worker].finish(scans[worker])

    return finish
