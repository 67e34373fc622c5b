"""What a worker does with rays that come: it traces them through its shards, and answers."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import closing
from dataclasses import dataclass
from enum import Enum
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from bfrt.cluster.counters import Part
from bfrt.cluster.reports import TaskReport
from bfrt.cluster.worker import this_worker
from bfrt.phases.all_hits import AllHits
from bfrt.progress import Progress
from bfrt.queries.extras import NO_EXTRAS, Extras
from bfrt.queries.surfaces import SURFACE, surfaces_of
from bfrt.records import HIT, NO_HIT, QUERY_RAY
from bfrt.rendering import stats_of
from bfrt.stats import Counters
from bfrt.streams.spool import Spool
from bfrt.tracer import Outcome, Tracer
from bfrt.wavefront.cargo import Cargo
from bfrt.wavefront.site import Site

#: A nearer hit: what a ray needs to go on, and its surface.
FOUND = np.dtype([("near", "<f8"), ("id", "<u8"), *SURFACE.descr])

#: A ray that something stops; the hits of a ray.
STOPPED = np.dtype([("number", "<u8")])
COUNTED = np.dtype([("number", "<u8"), ("count", "<u4")])

Records = NDArray[Any]


class Find(Enum):
    """Says what is to be found, and by which records it is told."""

    NEAREST = FOUND
    ANY = STOPPED
    COUNT = COUNTED
    ALL = SURFACE


class Arrived:
    """Queues rays that have come, with the hits that they have."""

    def __init__(self, rays: Records) -> None:
        self._rays = rays

    def __len__(self) -> int:
        return len(self._rays)

    def read(self, most: int) -> Records:
        """Return the next rays, (n,) of records.HIT with n <= most."""
        some, self._rays = self._rays[:most], self._rays[most:]
        return some


class Gathered:
    """Gathers rays as they are complete, in place of a spool: no more than have come."""

    def __init__(self, which: Callable[[Records], Records]) -> None:
        self._which = which
        self._some: list[Records] = []

    def append(self, records: Records) -> None:
        self._some.append(self._which(records.view(QUERY_RAY)).copy())

    def all(self) -> Records:
        """Return all of them."""
        return np.concatenate([np.empty(0, QUERY_RAY), *self._some])


class Traced(NamedTuple):
    """Holds what a worker has found.

    Attributes
    ----------
    cargo : Cargo
        Of the records that `Find` names.
    part : Part
        The worker's name, and its counters.
    """

    cargo: Cargo
    part: Part


@dataclass(frozen=True)
class Trace(Site):
    """Traces rays of a query through some shards, as a task.

    Attributes
    ----------
    find : Find
    extras : Extras
        What a nearest hit tells beside its surface.
    """

    find: Find
    extras: Extras = NO_EXTRAS

    @property
    def record(self) -> np.dtype[Any]:
        """Return the type of the records that tell what is found."""
        return self.extras.record(self.find.value)

    def __call__(self, cargo: Cargo) -> Traced:
        rays = cargo.records(HIT)
        report = TaskReport()
        with self.tracer() as tracer:
            stats = stats_of(tracer)
            tracer.begin(stats)
            with stats.depth(1) as counters:
                found = FINDERS[self.find](Passing(tracer, rays, counters, report, self.extras))
                counters.rays.eye = len(rays)
            return Traced(Cargo.of(found), (this_worker().name, stats))


@dataclass
class Passing:
    """Takes rays through a tracer.

    Attributes
    ----------
    tracer : Tracer
    rays : (n,) records.HIT
        With paths of QUERY_RAY.
    counters : Counters
    report : TaskReport
        Ends the task if nobody waits for it.
    extras : Extras
    """

    tracer: Tracer
    rays: Records
    counters: Counters
    report: TaskReport
    extras: Extras = NO_EXTRAS

    def go(self, which: Callable[[Records], Records], crossings: AllHits | None = None) -> Records:
        """Trace all rays; return the records that are chosen as they are complete."""
        gathered, total = Gathered(which), len(self.rays)
        outcome = Outcome(gathered, None, crossings)
        queue = Arrived(self.rays)
        self.tracer.trace(
            queue, outcome, self.counters, lambda done: self.report(Progress(1, done, total))
        )
        return gathered.all()

    def spool(self) -> Spool:
        """Return a spool for hits, no more of them in memory than the budget has room for."""
        return Spool(HIT, self.tracer.capacities.hits, self.tracer.scratch)

    def surfaces(self, hits: Spool) -> Records:
        """Return hits with their surfaces, (n,) of SURFACE with the extras."""
        room = max(1, self.tracer.capacities.hits)
        found = surfaces_of(hits, self.tracer, room, self.counters, self.extras)
        return np.concatenate([np.empty(0, self.extras.record(SURFACE)), *found])


def _nearest(passing: Passing) -> Records:
    """Return the hits that are nearer than those that rays came with."""
    came = passing.rays.view(QUERY_RAY)
    first = int(came["number"].min(initial=0))
    before = np.full(int(came["number"].max(initial=0)) - first + 1, NO_HIT, np.uint64)
    before[came["number"].astype(np.int64) - first] = came["id"]

    def nearer(rays: Records) -> Records:
        chosen: Records = rays[rays["id"] != before[rays["number"].astype(np.int64) - first]]
        return chosen

    hits = passing.go(nearer)
    with closing(passing.spool()) as spool:
        spool.append(hits.view(HIT))
        surfaces = passing.surfaces(spool)
    found = np.empty(len(hits), passing.extras.record(FOUND))
    hits, surfaces = hits[np.argsort(hits["number"])], surfaces[np.argsort(surfaces["number"])]
    found["near"], found["id"] = hits["t"], hits["id"]
    for name in surfaces.dtype.names or ():
        found[name] = surfaces[name]
    return found


def _any(passing: Passing) -> Records:
    """Return the rays that something stops, which do not come out."""
    free = passing.go(lambda rays: rays)
    stopped = np.setdiff1d(passing.rays.view(QUERY_RAY)["number"], free["number"])
    return stopped.astype("<u8").view(STOPPED)


def _count(passing: Passing) -> Records:
    """Return the numbers of hits of the rays that have any."""
    met = passing.go(lambda rays: rays[rays["count"] > 0], AllHits())
    found = np.empty(len(met), COUNTED)
    found["number"], found["count"] = met["number"], met["count"]
    return found


def _all(passing: Passing) -> Records:
    """Return all hits."""
    with closing(passing.spool()) as spool:
        passing.go(lambda rays: rays[:0], AllHits(lambda found: spool.append(found.view(HIT))))
        return passing.surfaces(spool)


FINDERS: dict[Find, Callable[[Passing], Records]] = {
    Find.NEAREST: _nearest,
    Find.ANY: _any,
    Find.COUNT: _count,
    Find.ALL: _all,
}
