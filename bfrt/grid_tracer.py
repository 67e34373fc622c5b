"""A session on a scene with a grid for each group, as the paper has it.

::

    GridTracer ─┬─ rays in flight               their memory, and their candidates'
                └─ a group's objects and grid   open files, marks, slabs, rays stored in voxels
"""

from __future__ import annotations

import itertools
import time

from bfrt.budget import GridCapacities
from bfrt.phases.traversal import Queue, Sink, Sinks, Traversal
from bfrt.records import HIT
from bfrt.scan.scans import GroupScans
from bfrt.settings import Settings
from bfrt.stats import Counters, Stats
from bfrt.store.store import Group, Store
from bfrt.streams.spool import Spool
from bfrt.traced_group import TracedGroup
from bfrt.tracer import Outcome, Tell, Tracer


class GridTracer(Tracer):
    """Finds what queues of rays meet in a scene: preprocess, traversal and intersection.

    All memory of these phases is taken here, but for the grid of one group where there are
    several: rays go through one after another, each of which takes the place of the one before.

    Parameters
    ----------
    store : Store
    settings : Settings
    capacities : GridCapacities
        What the memory budget has room for.

    Attributes
    ----------
    groups : list of TracedGroup
        The groups, each with its grid.
    """

    capacities: GridCapacities

    def __init__(self, store: Store, settings: Settings, capacities: GridCapacities) -> None:
        start = time.perf_counter()
        super().__init__(store, settings, capacities)
        self._entered: TracedGroup | None = None
        try:
            self.groups = [self._traced(group) for group in store.groups]
            with self.prepared.phases.preprocess.timed():
                for group in self.groups:
                    group.preprocess(capacities.subspace, self.prepared, fresh=settings.fresh_marks)
            self._traversal = Traversal(capacities.rays, capacities.candidates, self.workers)
            room = capacities.hits if len(self.groups) > 1 else 0
            self._between = [Spool(HIT, room, self.scratch) for _ in range(2)]
            self.prepared.seconds = time.perf_counter() - start
        except BaseException:
            self.workers.close()
            raise

    def _traced(self, group: Group) -> TracedGroup:
        plan, lazy = self.capacities, self.settings.refinement.lazy
        scans = GroupScans(self.store, group, plan.threads, plan.read_buffer, lazy)
        return TracedGroup(self.store, group, self.settings, plan.limits, scans, self.workers)

    @property
    def scans(self) -> list[GroupScans]:
        """Return the objects of each group."""
        return [group.scans for group in self.groups]

    @property
    def bad(self) -> int:
        """Return the number of rays so far that were NaN or had no direction."""
        return self._traversal.bad

    def close(self) -> None:
        self._leave()
        for spool in self._between:
            spool.close()
        super().close()

    def begin(self, stats: Stats) -> None:
        """Add the work of preparing to a record of counters; a second one gets none of it."""
        stats.marks_reused = all(group.marks_reused for group in self.groups)
        stats.grids.extend(group.facts for group in self.groups)
        super().begin(stats)
        for group in self.groups:
            group.marks_reused = True

    def trace(self, queue: Queue, outcome: Outcome, counters: Counters, tell: Tell) -> None:
        """Find what every ray in `queue` meets; `tell` gets the rays finished so far."""
        passage = Passage(self._traversal, counters, tell)
        self._traversal.begin(outcome.crossings)
        last = self.groups[-1]
        for group, between in zip(self.groups, itertools.cycle(self._between), strict=False):
            hits: Sink = outcome.hits if group is last else between
            sinks = Sinks(hits, outcome.film, self.background, group is last)
            if len(queue):
                self._enter(group)
            passage.go(group, queue, sinks)
            for spool in self._between:
                counters.phases.traversal.spooled(spool)
                if spool is queue:
                    spool.clear()
            queue = between
        tell(passage.done)

    def _enter(self, group: TracedGroup) -> None:
        if self._entered is not group:
            self._leave()
            self._traversal.enter(group.open(self.capacities.blocks, self.capacities.subspace))
            self._entered = group

    def _leave(self) -> None:
        if self._entered is not None:
            self._entered.close()
            self._entered = None


class Passage:
    """Takes a queue of rays through the groups: the paper's ``intersection()``.

    Attributes
    ----------
    done : int
        Rays that are finished.
    """

    def __init__(self, traversal: Traversal, counters: Counters, tell: Tell) -> None:
        self.done = 0
        self._traversal = traversal
        self._counters = counters
        self._tell = tell

    def go(self, group: TracedGroup, queue: Queue, sinks: Sinks) -> None:
        """Take a queue through one group."""
        traversal, counters, phases = self._traversal, self._counters, self._counters.phases
        while len(queue) or traversal.active:
            self._tell(self.done)
            with phases.traversal.timed():
                self.done += traversal.admit(queue, sinks, counters)
                if traversal.active:
                    traversal.collect(group.read, counters, selective=group.selective)
            if traversal.active:
                with phases.intersection.timed():
                    group.intersect(traversal, counters)
                with phases.traversal.timed():
                    self.done += traversal.retire(sinks, counters)
