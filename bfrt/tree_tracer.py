"""A session on a scene in spatial order: rays go through its treelets, which stream or stay.

::

    while there are rays, in memory or waiting:
        admit          rays enter, to fill memory
        collect        each finds its next treelets, front to back, and its sentinel
        intersect      treelets that have rays, forwards; each ray down the treelet's own tree
        retire         rays with a hit nearer than their sentinel leave, and those without one
"""

from __future__ import annotations

import os
import time

import numpy as np

from bfrt.budget import Capacities
from bfrt.phases.preprocess import padding_of
from bfrt.phases.traversal import FIRST_QUOTA, Queue, Sinks
from bfrt.records import HIT
from bfrt.scan.scans import GroupScans
from bfrt.settings import Settings
from bfrt.stats import Counters, Stats
from bfrt.store.store import Store
from bfrt.tracer import Outcome, Tell
from bfrt.tree.forest import Forest
from bfrt.tree.rays import TreeIntersector, TreeRays
from bfrt.workers import Workers

#: Rays that enter memory at once; rays and treelets that a thread takes at once.
ADMITTED = 65536
RAYS_AT_ONCE = 2048
TREELETS_AT_ONCE = 16


class TreeTracer:
    """Finds what queues of rays meet in a scene: as `Tracer` does, by the scene's treelets."""

    def __init__(self, store: Store, settings: Settings, capacities: Capacities) -> None:
        start = time.perf_counter()
        self.store = store
        self.settings = settings
        self.capacities = capacities
        self.scratch = settings.scratch_beside(store.path)
        self.prepared = Counters()
        self.bad = 0
        self.workers = Workers(capacities.threads)
        self._process = os.getpid()
        self._background = np.array(store.background, np.float64)
        self.scans = [
            GroupScans(store, group, capacities.threads, capacities.read_buffer, True)
            for group in store.groups
        ]
        whole = Forest.resident_bytes(store) + Forest.bytes(store)
        self._forest = Forest(store, padding_of(store), whole < settings.memory // 2)
        self._rays = TreeRays(self._forest, capacities.rays, capacities.candidates)
        order = self.scans[0].order
        self._order = order
        self._intersectors = [TreeIntersector(self._forest, order) for _ in range(capacities.threads)]
        self._hits = np.empty((capacities.threads, RAYS_AT_ONCE), HIT)
        self.prepared.seconds = time.perf_counter() - start

    def serves(self, settings: Settings) -> bool:
        """Tell whether it works with these settings here: a forked process lacks its threads."""
        return self.settings == settings and self._process == os.getpid()

    def __enter__(self) -> TreeTracer:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """End the threads."""
        self.workers.close()

    def begin(self, stats: Stats) -> None:
        """Add the work of preparing to a record of counters; a second one gets none of it."""
        stats.total.add(self.prepared)
        self.prepared = Counters()

    def trace(self, queue: Queue, outcome: Outcome, counters: Counters, tell: Tell) -> None:
        """Find what every ray in `queue` meets; `tell` gets the rays finished so far."""
        rays, phases = self._rays, counters.phases
        sinks = Sinks(outcome.hits, outcome.film, self._background, last=True)
        crossings = outcome.crossings
        if crossings is not None:
            crossings.attach(*rays.all)
        for intersector in self._intersectors:
            intersector.begin(None if crossings is None else crossings.buffer())
        done, each = 0, FIRST_QUOTA
        while len(queue) or rays.active:
            tell(done)
            with phases.traversal.timed():
                if len(queue):
                    each = FIRST_QUOTA
                while len(queue) and rays.active < rays.capacity:
                    self._admit(queue)
                each = max(1, min(each, rays.room // max(1, rays.active)))
                self._collect(each, counters)
                each *= 2
            with phases.intersection.timed():
                self._intersect(counters)
            with phases.traversal.timed():
                done += self._retire(sinks, counters)
        tell(done)

    def _admit(self, queue: Queue) -> None:
        rays = self._rays
        some = queue.read(min(ADMITTED, rays.capacity - rays.active))
        come = rays.admit_again if some.dtype == HIT else rays.admit
        self.workers.run(
            lambda _, first, last: self._count_bad(come(some, first, last)), len(some),
            smallest=RAYS_AT_ONCE,
        )  # fmt: skip
        rays.come(len(some))

    def _count_bad(self, bad: int) -> None:
        self.bad += bad

    def _collect(self, each: int, counters: Counters) -> None:
        rays = self._rays
        tests: list[int] = []
        rays.begin_pass()
        self.workers.run(
            lambda _, first, last: tests.append(rays.collect(first, last, each)), rays.active,
            smallest=RAYS_AT_ONCE, largest=RAYS_AT_ONCE,
        )  # fmt: skip
        counters.box_tests += sum(tests)

    def _intersect(self, counters: Counters) -> None:
        found, starts = self._rays.candidates()
        treelets = len(starts) - 1

        def meet(worker: int, first: int, last: int) -> None:
            self._intersectors[worker].meet(self._rays, found, starts[first : last + 1])

        self.workers.run(meet, treelets, largest=TREELETS_AT_ONCE)
        self._order.check()
        counters.passes += 1
        for intersector in self._intersectors:
            nodes, objects = intersector.tests()
            counters.box_tests += nodes
            counters.object_tests += objects
        read, seeks = self._forest.counts()
        counters.phases.intersection.bytes_read += read
        counters.phases.intersection.seeks += seeks

    def _retire(self, sinks: Sinks, counters: Counters) -> int:
        rays = self._rays
        before = rays.active
        parts: list[tuple[int, int]] = []
        eyes: list[int] = []

        def chunk(worker: int, first: int, last: int) -> None:
            found = self._hits[worker]
            kept, n, eye = rays.retire(first, last, sinks.film, sinks.background, found)
            sinks.hits.append(found[:n])
            parts.append((first, kept))
            eyes.append(eye)

        self.workers.run(chunk, before, smallest=RAYS_AT_ONCE, largest=RAYS_AT_ONCE)
        if sinks.film is not None:
            counters.rays.eye_hits += sum(eyes)
        firsts, counts = np.array(sorted(parts), np.int64).reshape(-1, 2).T.copy()
        rays.compact(firsts, counts)
        return before - rays.active
