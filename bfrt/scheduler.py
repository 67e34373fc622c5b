"""The depth loop: breadth-first ray tracing as the paper tells it (its figure 1).

::

    preprocess                        mark the voxels where boxes begin
    for each depth:
        for each group:
            while there are rays, in memory or waiting:
                admit                 rays enter, to fill memory, and walk to their first candidate
                collect               each walks on to its candidates of this pass, and its sentinel
                intersect             all objects stream past the rays stored in their voxels
                retire                complete rays leave: to the next group, after the last to
                                      the hits, or with light to the film
        shade                         hits in object order; reflection, refraction, shadow rays

One depth's rays of all kinds are traced together. The last depth's hits send shadow rays only,
which one more iteration traces.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from bfrt.image.film import Film
from bfrt.phases.eye import EyeRays, view_vectors
from bfrt.phases.shading import Shading
from bfrt.phases.traversal import Queue
from bfrt.progress import Progress, Report, tell
from bfrt.records import HIT, QUEUED
from bfrt.stats import Counters, Stats
from bfrt.streams.spool import Spool
from bfrt.tracer import Outcome, Tracer
from bfrt.view import View

#: Called with a band of the film that is complete.
Take = Callable[[Film], None]


@dataclass
class RenderState:
    """Holds all the state of a render between two depths.

    Attributes
    ----------
    band : int
        The band of rows that is rendered, from 1.
    depth : int
        The depth that was traced last, from 1; 0 before the first.
    queue : Queue
        Rays of the next depth: the camera's, then `waiting`.
    waiting, following : Spool
        Rays of the next depth and of the one after it.
    hits : Spool
        Hits that wait for shading; empty between depths.
    film : Film
        The light so far, of this band.
    stats : Stats
        The counters so far.
    """

    band: int
    depth: int
    queue: Queue
    waiting: Spool
    following: Spool
    hits: Spool
    film: Film
    stats: Stats

    def turn(self) -> None:
        """Go on to the next depth: the rays just made become the waiting ones."""
        self.hits.clear()
        self.waiting, self.following = self.following, self.waiting
        self.queue = self.waiting

    def close(self) -> None:
        """Free the disk."""
        for spool in (self.waiting, self.following, self.hits):
            spool.close()


class Render:
    """Traces one view of a scene, band by band.

    Parameters
    ----------
    tracer : Tracer
    view : View
    stats : Stats
        The counters of the render.
    report : Report
        Called after each pass.
    """

    def __init__(self, tracer: Tracer, view: View, stats: Stats, report: Report) -> None:
        self._tracer = tracer
        self._view = view
        self._report = report
        plan, store = tracer.capacities, tracer.store
        self._bands = plan.bands(view.camera.resolution[1])
        film = Film(*view.camera.resolution, view.samples, plan.rows, view.aovs)
        waiting = Spool(QUEUED, plan.queue, tracer.scratch)
        self._state = RenderState(
            band=0,
            depth=0,
            queue=waiting,
            waiting=waiting,
            following=Spool(QUEUED, plan.queue, tracer.scratch),
            hits=Spool(HIT, plan.hits, tracer.scratch),
            film=film,
            stats=stats,
        )
        eye = view_vectors(view.camera, store.origin)[0]
        self._shading = Shading(store, view.lights, film, eye, plan.hits, tracer.workers)

    def run(self, take: Take) -> None:
        """Trace all bands, and give each away when it is complete."""
        state = self._state
        self._tracer.begin(state.stats)
        try:
            for band in range(1, self._bands + 1):
                state.band, state.depth = band, 0
                state.queue = EyeRays(
                    self._tracer.store, self._view.camera, self._view.samples,
                    *state.film.elements(),
                )  # fmt: skip
                while len(state.queue):
                    self._one_depth()
                take(state.film)
                state.film.advance()
        finally:
            state.close()
        state.stats.bad_rays = self._tracer.bad

    def _one_depth(self) -> None:
        """Trace the waiting rays, and shade their hits."""
        state = self._state
        state.depth += 1
        with state.stats.depth(state.depth) as counters:
            if state.depth == 1:
                counters.rays.eye = len(state.queue)
            self._trace(counters)
            with counters.phases.shading.timed():
                state.following.clear()
                last = state.depth >= self._view.depth
                self._shading.shade(self._tracer.scans, state.hits, state.following, last, counters)
            for spool in (state.hits, state.waiting, state.following):
                counters.phases.shading.spooled(spool)
        state.turn()

    def _trace(self, counters: Counters) -> None:
        """Find the hits of the rays that wait."""
        state = self._state
        start = Progress(state.depth, 0, len(state.queue), state.band, self._bands)
        self._tracer.trace(
            state.queue,
            Outcome(state.hits, state.film),
            counters,
            lambda done: tell(self._report, start._replace(done=done)),
        )
