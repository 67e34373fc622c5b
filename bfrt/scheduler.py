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
which one more iteration traces. Between any two passes the whole state can be saved, and a render
that was killed goes on from there.
"""

from __future__ import annotations

import time

import numpy as np
from numpy.typing import NDArray

from bfrt.checkpoint.checkpoint import Checkpoint
from bfrt.checkpoint.state import Facts, SavedState, StateWriter
from bfrt.image.film import Film
from bfrt.image.image_buffer import ImageBuffer, resolve
from bfrt.phases.hit_order import HitLoads
from bfrt.phases.shading import Shading
from bfrt.phases.viewpoints import viewpoints_of
from bfrt.progress import Progress, Report, tell
from bfrt.render_state import RenderState
from bfrt.stats import Counters, Stats
from bfrt.tracer import Outcome, Tracer
from bfrt.view import Views


class Render:
    """Traces views of a scene together, band by band.

    Parameters
    ----------
    tracer : Tracer
    views : Views
    stats : Stats
        The counters of the render.
    report : Report
        Called after each pass.
    checkpoint : Checkpoint, optional
        Keeps the state between passes; the render goes on from the one that it has found.
    """

    def __init__(
        self,
        tracer: Tracer,
        views: Views,
        stats: Stats,
        report: Report,
        checkpoint: Checkpoint | None = None,
    ) -> None:
        self._tracer = tracer
        self._depth = views.depth
        self._background = views.illumination.background
        self._report = report
        self._checkpoint = checkpoint
        self._resumed = None if checkpoint is None else checkpoint.found
        self._start = time.perf_counter()
        self._began = self._start  # of the depth
        self._bad = -tracer.bad  # those of work before
        store, room = tracer.store, tracer.capacities
        self._state = RenderState.first(store, room, tracer.scratch, views, stats)
        film, seen = self._state.film, viewpoints_of(views, store.origin)
        self._shading = Shading(store, seen, film, room.hits, tracer.workers)

    def run(self) -> ImageBuffer:
        """Trace all bands; return the finished pictures."""
        state = self._state
        self._tracer.begin(state.stats)
        try:
            if self._resumed is not None:
                state.restore(self._resumed)
                self._bad += self._resumed.facts["bad"]
            while True:
                while len(state.queue) or self._resumed is not None:
                    self._one_depth()
                resolve(state.film, state.image)
                if state.band == state.bands:
                    break
                state.next_band()
        except BaseException:
            state.image.close()
            raise
        finally:
            state.close()
        state.stats.bad_rays = self._bad + self._tracer.bad
        return state.image

    def run_rows(self, rows: NDArray[np.uint32]) -> Film:
        """Trace some rows of the frame's elements; return the film, which begins with them."""
        state = self._state
        state.take_rows(rows)
        self._tracer.begin(state.stats)
        try:
            while len(state.queue):
                self._one_depth()
        finally:
            state.close()
        state.stats.bad_rays = self._bad + self._tracer.bad
        return state.film

    def _one_depth(self) -> None:
        """Trace the waiting rays, and shade their hits; or the rest of that."""
        state = self._state
        saved, self._resumed = self._resumed, None
        state.depth += 1
        self._began = time.perf_counter()
        with state.stats.depth(state.depth) as counters:
            if state.depth == 1 and saved is None:
                counters.rays.eye = len(state.queue)
            if saved is None or not saved.facts["shading"]:
                self._trace(saved, counters)
                state.following.clear()
            elif self._checkpoint is not None:
                self._checkpoint.went_on(
                    f"band {state.band} of {state.bands}, depth {state.depth}, "
                    f"{len(state.hits):,} hits to shade"
                )
            self._shade(counters)
        state.turn()

    def _trace(self, saved: SavedState | None, counters: Counters) -> None:
        """Find the hits of the rays that wait, and of those that were in flight."""
        state = self._state
        outcome = Outcome(state.hits, state.film, background=self._background)
        start = Progress(state.depth, 0, len(state.queue), state.band, state.bands)
        if saved is not None:
            start = self._go_on(saved, start, outcome, counters)

        def between_passes(done: int) -> None:
            progress = start._replace(done=start.done + done)
            if self._checkpoint is None:
                tell(self._report, progress)
                return
            self._checkpoint.between_passes(
                lambda writer: self._save(writer, counters, progress),
                self._tracer.state_bytes + state.bytes(len(state.hits)),
                lambda: tell(self._report, progress),
            )

        self._tracer.trace(state.queue, outcome, counters, between_passes)

    def _shade(self, counters: Counters) -> None:
        """Shade the hits, and gather the rays that go on."""
        state, phase = self._state, counters.phases.shading
        last = state.depth >= self._depth

        def between_loads(loads: HitLoads) -> None:
            if self._checkpoint is not None and len(loads):
                self._checkpoint.between_passes(
                    lambda writer: self._save(writer, counters, loads),
                    state.bytes(len(loads)),
                    lambda: None,
                )

        scans = self._tracer.scans
        with phase.timed():
            self._shading.shade(scans, state.hits, state.following, last, counters, between_loads)
        for spool in (state.hits, state.waiting, state.following):
            phase.spooled(spool)

    def _go_on(
        self, saved: SavedState, start: Progress, outcome: Outcome, counters: Counters
    ) -> Progress:
        """Bring rays back to where they were, or trace anew those for which there is no way back.

        Returns
        -------
        Progress
            How far the depth is.
        """
        facts = saved.facts
        start = start._replace(done=facts["done"], total=facts["total"])
        if self._checkpoint is not None:
            self._checkpoint.went_on(
                f"band {start.band} of {start.bands}, depth {start.depth}, "
                f"{start.done:,} of {start.total:,} rays"
            )
        again = self._tracer.begun_again(saved, facts["tracer"])
        if again is not None:
            rays = len(again)
            self._tracer.trace(again, outcome, counters, lambda _: tell(self._report, start))
            start = start._replace(done=start.done + rays)
        self._tracer.restore(saved, facts["tracer"], rays=again is None)
        return start

    def _save(self, writer: StateWriter, counters: Counters, at: Progress | HitLoads) -> Facts:
        """Save everything: rays in flight, those that wait, hits, film, picture, counters.

        Parameters
        ----------
        at : Progress or HitLoads
            How far the rays of the depth are, or the hits that are still to be shaded.
        """
        state = self._state
        if isinstance(at, HitLoads):
            facts = {
                **state.save(writer, at.waiting()),
                "shading": True,
                "tracer": None,
                "done": 0,
                "total": 0,
            }
        else:
            facts = {
                **state.save(writer, state.hits.waiting()),
                "shading": False,
                "tracer": self._tracer.save(writer),
                "done": at.done,
                "total": at.total,
            }
        facts["bad"] = self._bad + self._tracer.bad
        facts["stats"] = state.stats.kept(
            state.depth, counters, started=self._start, began=self._began
        )
        return facts
