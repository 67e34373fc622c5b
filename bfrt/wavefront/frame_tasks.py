"""What a worker does for a picture: it finds nearest hits, and shades those on its objects."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import closing, contextmanager
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from bfrt.cluster.counters import Part
from bfrt.cluster.reports import TaskReport
from bfrt.cluster.worker import this_worker
from bfrt.image.film_parts import film_of, part_of
from bfrt.phases.shading import Shading
from bfrt.phases.viewpoints import Viewpoints
from bfrt.progress import Progress
from bfrt.records import HIT, QUERY_RAY, QUEUED, RayKind
from bfrt.rendering import stats_of
from bfrt.stats import Counters, Stats, peak_rss
from bfrt.tracer import Tracer
from bfrt.wavefront.cargo import Cargo
from bfrt.wavefront.site import Site
from bfrt.wavefront.tasks import Passing, Traced

Records = NDArray[Any]

#: What a ray has met that is nearer than before: its place in its cargo, where, and what.
MET = np.dtype([("place", "<u4"), ("t", "<f8"), ("id", "<u8")])

#: What is told of a shadow ray that something stops; what that is does not matter.
STOPPED_AT, STOPPED_BY = -1.0, 0


class Shaded(NamedTuple):
    """Holds what shading has made of hits.

    Attributes
    ----------
    rays : Cargo
        Those that go on, of records.QUEUED.
    sums, seen : Cargo
        The elements of the film that got light, and those of first samples (`FilmPart`).
    part : Part
        The worker's name, and its counters.
    """

    rays: Cargo
    sums: Cargo
    seen: Cargo
    part: Part


@contextmanager
def counted(tracer: Tracer, stats: Stats) -> Iterator[Counters]:
    """Yield the counters of a task, which is one depth's, and has no other."""
    tracer.begin(stats)
    with stats.depth(1) as counters:
        yield counters
    stats.peak_rss_bytes = peak_rss()


@dataclass(frozen=True)
class Preparing:
    """Gets the shards of a carrier ready, as a task: marks are made, where they are not there."""

    site: Site

    def __call__(self, fresh_marks: bool) -> Part:
        with self.site.tracer(fresh_marks=fresh_marks) as tracer:
            stats = stats_of(tracer)
            tracer.begin(stats)
            stats.peak_rss_bytes = peak_rss()
            return this_worker().name, stats


@dataclass(frozen=True)
class Meeting:
    """Finds what rays meet in some shards, as a task; any object is enough for a shadow ray.

    It is given rays of records.QUERY_RAY, with the hits that they have; `number` is the place.
    """

    site: Site

    def __call__(self, cargo: Cargo) -> Traced:
        rays = cargo.records(QUERY_RAY)
        with self.site.tracer() as tracer:
            stats = stats_of(tracer)
            with counted(tracer, stats) as counters:
                met = _met(Passing(tracer, rays.view(HIT), counters, TaskReport()))
            return Traced(Cargo.of(met), (this_worker().name, stats))


def _met(passing: Passing) -> Records:
    """Return the hits that are nearer than those that rays came with, by their places."""
    came = passing.rays.view(QUERY_RAY)
    stopped = came["kind"] == RayKind.SHADOW

    def nearer(rays: Records) -> Records:
        places = rays["number"]
        stopped[places] = False  # which come out only if nothing stops them
        chosen: Records = rays[rays["id"] != came["id"][places]]
        return chosen

    hits = passing.go(nearer)
    places = np.flatnonzero(stopped)
    met = np.empty(len(hits) + len(places), MET)
    met["place"] = np.concatenate([hits["number"].astype(np.int64), places])
    met["t"][: len(hits)], met["id"][: len(hits)] = hits["t"], hits["id"]
    met["t"][len(hits) :], met["id"][len(hits) :] = STOPPED_AT, STOPPED_BY
    return met[np.argsort(met["place"])]


@dataclass(frozen=True)
class HitShading:
    """Shades hits on the objects of some shards, as a task.

    Attributes
    ----------
    site : Site
    viewpoints : Viewpoints
        Of the views of the whole frame.
    aovs : tuple of str
        As in `Views`.
    last : bool
        Whether the maximum depth is reached.
    """

    site: Site
    viewpoints: Viewpoints
    aovs: tuple[str, ...]
    last: bool

    def __call__(self, cargo: Cargo) -> Shaded:
        hits = cargo.records(HIT)
        elements, own = np.unique(hits["pixel"], return_inverse=True)
        seen = np.zeros(len(elements), np.bool_)
        seen[own[(hits["kind"] == RayKind.EYE) & (hits["sample"] == 0)]] = True
        hits["pixel"] = own
        film = film_of(elements, self.aovs)
        following = Following(elements)
        with self.site.tracer() as tracer:
            room = max(1, tracer.capacities.hits)
            shading = Shading(tracer.store, self.viewpoints, film, room, tracer.workers)
            stats = stats_of(tracer)
            with counted(tracer, stats) as counters:
                self._shade(shading, Passing(tracer, hits, counters, TaskReport()), following)
        part = part_of(film, elements, seen, self.aovs)
        own_part = this_worker().name, stats
        return Shaded(Cargo.of(following.all()), Cargo.of(part.sums), Cargo.of(part.seen), own_part)

    def _shade(self, shading: Shading, passing: Passing, following: Following) -> None:
        tracer, counters = passing.tracer, passing.counters
        phase, total = counters.phases.shading, len(passing.rays)
        with phase.timed(), closing(passing.spool()) as spool:
            spool.append(passing.rays)
            shading.shade(
                tracer.scans, spool, following, self.last, counters,
                lambda left: passing.report(Progress(1, total - len(left), total)),
            )  # fmt: skip
            phase.spooled(spool)


class Following:
    """Gathers rays that go on, with their elements in the whole film.

    Parameters
    ----------
    elements : (n,) uint32
        The number there of each element of a film of some.
    """

    def __init__(self, elements: NDArray[np.uint32]) -> None:
        self._elements = elements
        self._some: list[Records] = []

    def append(self, records: Records) -> None:
        """Add a copy of `records` (n,); threads may do it at once."""
        own = records.copy()
        own["pixel"] = self._elements[own["pixel"]]
        self._some.append(own)

    def all(self) -> Records:
        """Return all of them, (n,) of records.QUEUED."""
        return np.concatenate([np.empty(0, QUEUED), *self._some])
