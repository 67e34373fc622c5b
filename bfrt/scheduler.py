"""The depth loop: breadth-first ray tracing as the paper tells it (its figure 1).

::

    preprocess                        mark the voxels where boxes begin
    for each depth:
        for each group:
            while there are rays, in memory or waiting:
                admit                 rays enter, to fill memory, and walk to their first candidate
                collect               each walks on to its candidates of this pass, and its sentinel
                intersect             all objects stream past the rays stored in their voxels
                settle                complete rays leave: to the next group, after the last to
                                      the hits, or with light to the film
        shade                         hits in object order; reflection, refraction, shadow rays

One depth's rays of all kinds are traced together. The last depth's hits send shadow rays only,
which one more iteration traces.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from bfrt.budget import Capacities
from bfrt.errors import Cancelled
from bfrt.image.film import Film
from bfrt.phases.crossings import Crossings
from bfrt.phases.eye import EyeRays, view_vectors
from bfrt.phases.field import Field
from bfrt.phases.shading import Shading
from bfrt.phases.traversal import Ends, Flight, Queue, Sink
from bfrt.records import HIT, QUEUED
from bfrt.scene.model import Camera
from bfrt.scene.store import Store
from bfrt.stats import Counters, Stats
from bfrt.streams.spool import Spool
from bfrt.workers import Workers


class Progress(NamedTuple):
    """Where a render is: the depth, and how many of its rays are finished.

    A frame that memory does not hold is rendered in bands of rows, each from its first depth on.
    """

    depth: int
    done: int
    total: int
    band: int = 1
    bands: int = 1


#: Called as often as a pass ends; returning False cancels.
Report = Callable[[Progress], object]


class Tracer:
    """Finds the nearest hits of queues of rays: preprocess, traversal and intersection.

    All memory of these phases is taken here, but for the grid of one group where there are
    several: rays go through one after another, each of which takes the place of the one before.

    Without a `film` all rays come to the hits, whether they have met something or not. With
    `crossings` each goes on to its end, and all that it meets goes there.

    Attributes
    ----------
    fields : list of Field
        The groups, each with its grid.
    """

    def __init__(
        self,
        store: Store,
        film: Film | None,
        workers: Workers,
        capacities: Capacities,
        *,
        refine: str,
        fresh_marks: bool,
        scratch: Path,
        counters: Counters,
        crossings: Crossings | None = None,
    ) -> None:
        self._film = film
        self._background = np.array(store.background, np.float64)
        self.fields = [
            Field(store, group, workers, capacities, refine, scratch) for group in store.groups
        ]
        with counters.phases.preprocess.timed():
            for field in self.fields:
                field.preprocess(fresh_marks, counters)
        self._flight = Flight(capacities.rays, capacities.candidates, workers, crossings)
        self._entered: Field | None = None
        several = len(self.fields) > 1
        room = capacities.hits if several else 0
        self._between = [Spool(HIT, room, scratch) for _ in range(2)]

    @property
    def bad(self) -> int:
        """Rays that were NaN or had no direction."""
        return self._flight.bad

    def close(self) -> None:
        """Close the marks, and give back what is on disk."""
        self._leave()
        for spool in self._between:
            spool.close()

    def trace(
        self, queue: Queue, hits: Sink, counters: Counters, tell: Callable[[int], None]
    ) -> None:
        """Find the nearest hit of every ray in `queue`; `tell` gets the rays finished so far.

        Intersections go to `hits`. What shadow rays bring, and the background, go to the film.
        """
        done = 0
        last = self.fields[-1]
        for field, between in zip(self.fields, itertools.cycle(self._between), strict=False):
            out: Sink = hits if field is last else between
            ends = Ends(out, self._film, self._background, field is last)
            done = self._trace_group(field, queue, ends, counters, tell, done)
            for spool in self._between:
                counters.phases.traversal.spooled(spool)
                if spool is queue:
                    spool.clear()
            queue = between
        tell(done)

    def _trace_group(
        self,
        field: Field,
        queue: Queue,
        ends: Ends,
        counters: Counters,
        tell: Callable[[int], None],
        done: int,
    ) -> int:
        """Take a queue through one group; returns the rays that are finished, `done` before."""
        flight, phases = self._flight, counters.phases
        if len(queue):
            self._enter(field)
        while len(queue) or flight.active:
            tell(done)
            with phases.traversal.timed():
                done += flight.admit(queue, ends, counters)
                if flight.active:
                    flight.collect(field.read, counters, selective=field.selective)
            if flight.active:
                with phases.intersection.timed():
                    field.intersect(flight, counters)
                with phases.traversal.timed():
                    done += flight.settle(ends, counters)
        return done

    def _enter(self, field: Field) -> None:
        if self._entered is not field:
            self._leave()
            self._flight.enter(field.open())
            self._entered = field

    def _leave(self) -> None:
        if self._entered is not None:
            self._entered.close()
            self._entered = None


#: Called with a band of the film that is complete.
Take = Callable[[Film], None]


def render_film(
    store: Store,
    camera: Camera,
    *,
    samples: int,
    depth: int,
    aovs: Sequence[str],
    capacities: Capacities,
    refine: str,
    fresh_marks: bool,
    scratch: Path,
    stats: Stats,
    report: Report,
    take: Take,
) -> None:
    """Trace one view of a scene, and give the film away band by band.

    Parameters
    ----------
    samples : int
        A pixel; 0 is SPD's procedure.
    depth : int
        Hits of this depth are the last that are shaded; the eye ray's is 1.
    aovs : sequence of str
        Which of `records.ON_REQUEST` the film keeps.
    refine : {"base", "sg", "sgb"}
        The paper's refinements.
    """
    film = Film(*camera.resolution, samples, capacities.rows, aovs)
    workers = Workers(capacities.threads)
    spools = [
        Spool(HIT, capacities.hits, scratch),
        Spool(QUEUED, capacities.queue, scratch),
        Spool(QUEUED, capacities.queue, scratch),
    ]
    try:
        tracer = Tracer(
            store,
            film,
            workers,
            capacities,
            refine=refine,
            fresh_marks=fresh_marks,
            scratch=scratch,
            counters=stats.total,
        )
        stats.marks_reused = all(field.marks_reused for field in tracer.fields)
        stats.grids.extend(field.facts for field in tracer.fields)
        eye = view_vectors(camera, store.origin)[0]
        shading = Shading(store, film, eye, capacities)
        bands = capacities.bands(camera.resolution[1])
        try:
            for band in range(1, bands + 1):
                rays = EyeRays(store, camera, samples, *film.elements())
                where = Progress(0, 0, 0, band, bands)
                _depths(tracer, shading, rays, spools, depth, stats, report, where)
                take(film)
                film.advance()
        finally:
            tracer.close()
        stats.bad_rays = tracer.bad
    finally:
        workers.close()
        for spool in spools:
            spool.close()


def _depths(
    tracer: Tracer,
    shading: Shading,
    eye_rays: EyeRays,
    spools: list[Spool],
    last_depth: int,
    stats: Stats,
    report: Report,
    where: Progress,
) -> None:
    """The depth loop."""
    hits, waiting, following = spools
    queue: Queue = eye_rays
    depth = 0
    while len(queue):
        depth += 1
        with stats.depth(depth) as counters:
            if depth == 1:
                counters.rays.eye = len(queue)
            start = where._replace(depth=depth, total=len(queue))
            tracer.trace(queue, hits, counters, _teller(report, start))
            with counters.phases.shading.timed():
                following.clear()
                objects = [field.objects for field in tracer.fields]
                shading.shade(objects, hits, following, depth >= last_depth, counters)
            for spool in spools:
                counters.phases.shading.spooled(spool)
        hits.clear()
        waiting, following = following, waiting
        queue = waiting


def _teller(report: Report, start: Progress) -> Callable[[int], None]:
    """What turns a count of finished rays into progress, and a False into the end."""

    def tell(done: int) -> None:
        if report(start._replace(done=done)) is False:
            raise Cancelled(
                f"cancelled at depth {start.depth}, with {done} of {start.total} rays finished"
            )

    return tell
