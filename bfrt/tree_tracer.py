"""A session on a scene in spatial order: rays go through its treelets, which stream or stay.

::

    while there are rays, in memory or waiting:
        admit          rays enter, to fill memory
        collect        each finds its next treelets, front to back, and its sentinel
        intersect      treelets that have rays, forwards; each ray down the treelet's own tree
        retire         rays with a hit nearer than their sentinel leave, and those without one

Where memory holds all treelets each ray goes down through them at once, in place of the middle two.
"""

from __future__ import annotations

import time
from collections.abc import Callable

import numpy as np

from bfrt.budget import TreeCapacities
from bfrt.checkpoint.state import Facts, SavedState, StateWriter
from bfrt.phases.flight import Pool, restore_flight, save_flight
from bfrt.phases.preprocess import padding_of
from bfrt.phases.traversal import ADMITTED, Queue, Sinks
from bfrt.records import HIT
from bfrt.scan.scans import GroupScans
from bfrt.settings import Settings
from bfrt.stats import Counters, Stats
from bfrt.store.store import Store
from bfrt.tracer import Outcome, Tell, Tracer
from bfrt.tree.casting import TreeCaster
from bfrt.tree.forest import Forest
from bfrt.tree.pieces import rooms
from bfrt.tree.rays import RAYS_AT_ONCE, TreeIntersector, TreeRays

#: Treelets that a ray meets in its first pass at the most, and how many times as many in each that
#: follows: most rays end soon, and each pass costs the others their way from the top again.
FIRST_QUOTA = 4
GROWTH = 2

#: Rays that go down at once; treelets that a thread takes at once.
DESCENDING = 1024
TREELETS_AT_ONCE = 128

#: Treelets that are read at once where all are; rays for each of them make that worth it.
LOADED_AT_ONCE = 64
RAYS_FOR_ALL = 0.5


class TreeTracer(Tracer):
    """Finds what queues of rays meet in a scene, by its treelets.

    Parameters
    ----------
    store : Store
        In spatial order.
    settings : Settings
    capacities : TreeCapacities

    Attributes
    ----------
    resident : bool
        Whether treelets stay in memory.
    casters : list of TreeCaster
        One a worker, where treelets stay.
    """

    capacities: TreeCapacities

    def __init__(self, store: Store, settings: Settings, capacities: TreeCapacities) -> None:
        start = time.perf_counter()
        super().__init__(store, settings, capacities)
        self.resident = capacities.resident
        self._bad = 0
        self._quota = FIRST_QUOTA
        try:
            self._scans = [
                GroupScans(store, group, capacities.threads, capacities.read_buffer, True)
                for group in store.groups
            ]
            self._order = self._scans[0].order
            self._forest = Forest(
                store, padding_of(store), self.resident, capacities.kept, not capacities.cached
            )
            self._rays = TreeRays(self._forest, capacities.rays, capacities.candidates)
            each = range(capacities.threads)
            room = rooms(store)
            self._intersectors = [TreeIntersector(self._forest, self._order, room) for _ in each]
            self.casters = [TreeCaster(self._forest, self._order) for _ in each]
            self._hits = np.empty((capacities.threads, RAYS_AT_ONCE), HIT)
            self._seen = 0
            self._all_there = not self.resident
            self.prepared.seconds = time.perf_counter() - start
        except BaseException:
            self.workers.close()
            raise

    @property
    def scans(self) -> list[GroupScans]:
        """Return the objects of each group."""
        return self._scans

    @property
    def bad(self) -> int:
        """Return the number of rays so far that were NaN or had no direction."""
        return self._bad

    def begin(self, stats: Stats) -> None:
        """Add the work of preparing to a record of counters; a second one gets none of it."""
        stats.tree = {"treelets": self._forest.treelets, "resident": self.resident}
        super().begin(stats)

    def trace(self, queue: Queue, outcome: Outcome, counters: Counters, tell: Tell) -> None:
        """Find what every ray in `queue` meets; `tell` gets the rays finished so far."""
        rays, phases = self._rays, counters.phases
        background = np.array(outcome.background, np.float64)
        sinks = Sinks(outcome.hits, outcome.film, background, last=True)
        crossings = outcome.crossings
        if crossings is not None:
            crossings.attach(*rays.all)
        for intersector in self._intersectors:
            intersector.begin(None if crossings is None else crossings.buffer())
        done = 0
        while len(queue) or rays.active:
            tell(done)
            with phases.traversal.timed():
                if len(queue):
                    self._quota = FIRST_QUOTA
                while len(queue) and rays.active < rays.capacity:
                    self._admit(queue)
                if not self.resident:
                    each = max(1, min(self._quota, rays.room // max(1, rays.active)))
                    self._collect(each, counters)
                    self._quota = GROWTH * each
            with phases.intersection.timed():
                if self.resident:
                    self._descend(counters)
                else:
                    self._intersect(counters)
            with phases.traversal.timed():
                done += self._retire(sinks, counters)
        tell(done)

    @property
    def pool(self) -> Pool:
        """Return the rays in flight."""
        return self._rays

    def where(self, group: int) -> str:
        """Tell whether sentinels are treelets; where all are in memory there is none."""
        return "memory" if self.resident else "treelets"

    def save(self, writer: StateWriter) -> Facts:
        """Save where `trace` is; only between two passes, when `tell` is called."""
        save_flight(self.pool, writer)
        return {"group": 0, "where": self.where(0), "quota": self._quota}

    def restore(self, saved: SavedState, facts: Facts, *, rays: bool) -> None:
        """Have the next `trace` begin where another was."""
        self._quota = facts["quota"]
        if rays:
            restore_flight(self.pool, saved, self._forest.treelets)

    def _expect(self, rays: int) -> None:
        """Read all treelets, if so many more rays are likely to come to most of them."""
        self._seen += rays
        if self._all_there or self._seen < RAYS_FOR_ALL * self._forest.treelets:
            return
        self.workers.run(
            lambda _, first, last: self._forest.load_part(first, last), self._forest.treelets,
            largest=LOADED_AT_ONCE,
        )  # fmt: skip
        self._all_there = True

    def cast(self, work: Callable[[int, int, int], None], rays: int, counters: Counters) -> None:
        """Have workers take rays down through treelets in memory, by their casters."""
        self._expect(rays)
        self.workers.run(work, rays, smallest=DESCENDING, largest=ADMITTED // 8)
        self._count(self.casters, counters)

    def _admit(self, queue: Queue) -> None:
        rays = self._rays
        some = queue.read(min(ADMITTED, rays.capacity - rays.active))
        come = rays.admit_again if some.dtype == HIT else rays.admit
        bad: list[int] = []
        self.workers.run(
            lambda _, first, last: bad.append(come(some, first, last)), len(some),
            smallest=RAYS_AT_ONCE,
        )  # fmt: skip
        rays.come(len(some))
        self._bad += sum(bad)

    def _collect(self, each: int, counters: Counters) -> None:
        rays = self._rays
        tests: list[int] = []
        rays.begin_pass()
        self.workers.run(
            lambda _, first, last: tests.append(rays.collect(first, last, each)), rays.active,
            smallest=RAYS_AT_ONCE, largest=RAYS_AT_ONCE,
        )  # fmt: skip
        counters.node_tests += sum(tests)

    def _intersect(self, counters: Counters) -> None:
        found, treelets, starts = self._rays.by_treelet()

        def meet(worker: int, first: int, last: int) -> None:
            self._intersectors[worker].meet(
                self._rays, found, treelets[first:last], starts[first : last + 1]
            )

        self.workers.run(meet, len(treelets), largest=TREELETS_AT_ONCE)
        counters.passes += 1
        self._count(self._intersectors, counters)

    def _descend(self, counters: Counters) -> None:
        self._expect(self._rays.active)

        def go(worker: int, first: int, last: int) -> None:
            self._intersectors[worker].descend(self._rays, first, last)

        self.workers.run(go, self._rays.active, smallest=DESCENDING, largest=DESCENDING)
        self._count(self._intersectors, counters)

    def _count(self, loops: list[TreeIntersector] | list[TreeCaster], counters: Counters) -> None:
        self._order.check()
        for loop in loops:
            nodes, objects = loop.tests()
            counters.node_tests += nodes
            counters.object_tests += objects
        phase = counters.phases.intersection
        read, seeks, treelets = self._forest.counts()
        phase.bytes_read += read
        phase.seeks += seeks
        counters.treelets_read += treelets

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
        rays.compact(0, firsts, counts)
        return before - rays.active
