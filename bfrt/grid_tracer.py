"""A session on a scene with a grid for each group, as the paper has it.

::

    GridTracer ─┬─ rays in flight               their memory, and their candidates'
                └─ a group's objects and grid   open files, marks, slabs, rays stored in voxels
"""

from __future__ import annotations

import time
from pathlib import Path

import numpy as np

from bfrt.budget import GridCapacities
from bfrt.checkpoint.soundness import expect
from bfrt.checkpoint.state import HEADER, Facts, SavedState, StateWriter
from bfrt.phases.flight import Pool, restore_flight, save_flight
from bfrt.phases.traversal import Queue, Sink, Sinks, Traversal
from bfrt.records import HIT, HIT_BYTES
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
    kept : Path, optional
        Folder of a checkpoint, for marks that are made.

    Attributes
    ----------
    groups : list of TracedGroup
        The groups, each with its grid.
    """

    capacities: GridCapacities

    def __init__(
        self,
        store: Store,
        settings: Settings,
        capacities: GridCapacities,
        kept: Path | None = None,
    ) -> None:
        start = time.perf_counter()
        super().__init__(store, settings, capacities)
        self._entered: TracedGroup | None = None
        self._first = self._number = 0  # groups: where the next trace begins, and where one is
        try:
            self.groups = [self._traced(group) for group in store.groups]
            with self.prepared.phases.preprocess.timed():
                for group in self.groups:
                    group.preprocess(
                        capacities.subspace, self.prepared, fresh=settings.fresh_marks, kept=kept
                    )
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
        background = np.array(outcome.background, np.float64)
        self._traversal.begin(outcome.crossings)
        first, self._first = self._first, 0
        for number, group in enumerate(self.groups[first:], first):
            self._number = number
            last = group is self.groups[-1]
            came, between = self._between[(number + 1) % 2], self._between[number % 2]
            hits: Sink = outcome.hits if last else between
            source: Queue = came if number else queue
            if len(source) or self._traversal.active:
                self._enter(group)
            passage.go(group, source, Sinks(hits, outcome.film, background, last))
            for spool in self._between:
                counters.phases.traversal.spooled(spool)
            if number:
                came.clear()
        self._number = len(self.groups)
        tell(passage.done)

    @property
    def pool(self) -> Pool:
        """Return the rays in flight."""
        return self._traversal.pool

    def where(self, group: int) -> str:
        """Tell which grid a group has; behind the last there is no ray that would be in it."""
        return self.groups[group].grid if group < len(self.groups) else "end"

    def save(self, writer: StateWriter) -> Facts:
        """Save where `trace` is; only between two passes, when `tell` is called."""
        save_flight(self.pool, writer)
        for name, spool in self._waiting.items():
            writer.put(name, spool.waiting())
        number = self._number
        return {"group": number, "where": self.where(number), "quota": self._traversal.quota}

    @property
    def state_bytes(self) -> int:
        """Return about as many bytes as `save` writes."""
        between = sum(len(spool) for spool in self._waiting.values())
        return super().state_bytes + between * HIT_BYTES

    def restore(self, saved: SavedState, facts: Facts, *, rays: bool) -> None:
        """Have the next `trace` begin where another was."""
        for name, spool in self._waiting.items():
            spool.restore(saved.blocks(name, HIT))
        self._first = facts["group"]
        expect(saved.folder / HEADER, "group", self._first, right=self._first <= len(self.groups))
        self._traversal.quota = facts["quota"]
        if rays:
            group = self.groups[self._first : self._first + 1]
            restore_flight(self.pool, saved, group[0].voxels if group else 0)

    @property
    def _waiting(self) -> dict[str, Spool]:
        """Return the spools between groups by the names of their files; none for one group."""
        spools = self._between if len(self.groups) > 1 else []
        return {f"between{number}": spool for number, spool in enumerate(spools)}

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
