"""The depth loop: breadth-first ray tracing as the paper tells it (its figure 1).

::

    preprocess                        mark the voxels where boxes begin
    for each depth:
        while there are rays, in memory or waiting:
            admit                     rays enter, to fill memory, and walk to their first candidate
            collect                   each walks on to its candidates of this pass, and its sentinel
            intersect                 all objects stream past the rays stored in their voxels
            settle                    complete rays leave: to the hits, or with light to the film
        shade                         hits in object order; reflection, refraction, shadow rays

One depth's rays of all kinds are traced together. The last depth's hits send shadow rays only,
which one more iteration traces.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import numpy as np

from bfrt.budget import Capacities
from bfrt.errors import Cancelled
from bfrt.image.film import Film
from bfrt.phases.eye import EyeRays, view_vectors
from bfrt.phases.intersection import intersect_all
from bfrt.phases.outliers import Outliers
from bfrt.phases.partition import partition_of
from bfrt.phases.preprocess import lattice_of, preprocess
from bfrt.phases.selection import Selections
from bfrt.phases.shading import Shading
from bfrt.phases.slabs import Slabs
from bfrt.phases.traversal import Flight, Queue
from bfrt.phases.voxel_rays import VoxelRays
from bfrt.records import HIT, QUEUED
from bfrt.scene.model import Camera
from bfrt.scene.objects import Objects
from bfrt.scene.store import Store
from bfrt.stats import Counters, Stats
from bfrt.streams.spool import Spool
from bfrt.workers import Workers


class Progress(NamedTuple):
    """Where a render is: the depth, and how many of its rays are finished."""

    depth: int
    done: int
    total: int


#: Called as often as a pass ends; returning False cancels.
Report = Callable[[Progress], object]


class Tracer:
    """Finds the nearest hits of queues of rays: preprocess, traversal and intersection.

    All memory of these phases is taken here.
    """

    def __init__(
        self,
        store: Store,
        film: Film,
        workers: Workers,
        capacities: Capacities,
        *,
        refine: str,
        fresh_marks: bool,
        scratch: Path,
        counters: Counters,
    ) -> None:
        (group,) = store.groups
        lazy = refine != "base"
        self.objects = Objects(store, group, workers, capacities.read_buffer, lazy)
        self._selections = Selections(group.streams) if refine == "sgb" else None
        self._film = film
        self._swept = sum(stream.count for stream in group.streams)
        self._background = np.array(store.background, np.float64)
        cut = partition_of(group, capacities.limits)
        lattice = lattice_of(store, group, cut.shape, cut.axis)
        with counters.phases.preprocess.timed():
            marks, self.marks_reused = preprocess(
                store,
                self.objects,
                self._selections,
                lattice,
                cut,
                capacities.subspace,
                fresh=fresh_marks,
                scratch=scratch,
                counters=counters,
            )
        self.grid = {
            "voxels": list(cut.shape),
            "lower": 1 << cut.lower_bits,
            "bricks": int(marks.first[-1]),
        }
        self._slabs = Slabs(lattice, marks, capacities.limits.slab, workers)
        self.grid["slabs"] = self._slabs.count
        self._voxel_rays = VoxelRays(
            cut.shape, capacities.candidates, cut.lower_bits, capacities.blocks
        )
        self._flight = Flight(
            capacities.rays, self._slabs, self._voxel_rays, Outliers(store, group), workers
        )

    def close(self) -> None:
        """Close the marks."""
        self._slabs.close()

    @property
    def bad(self) -> int:
        """Rays that were NaN or had no direction."""
        return self._flight.bad

    def trace(
        self, queue: Queue, hits: Spool, counters: Counters, tell: Callable[[int], None]
    ) -> None:
        """Find the nearest hit of every ray in `queue`; `tell` gets the rays finished so far.

        Intersections go to `hits`. What shadow rays bring, and the background, go to the film.
        """
        flight, film, background = self._flight, self._film, self._background
        phases = counters.phases
        done = 0
        while len(queue) or flight.active:
            tell(done)
            with phases.traversal.timed():
                done += flight.admit(queue, film, background, hits, counters)
                if flight.active:
                    flight.collect(self._swept, counters)
            if flight.active:
                with phases.intersection.timed():
                    self._swept = intersect_all(
                        self.objects, self._selections, flight, self._voxel_rays, counters
                    )
                with phases.traversal.timed():
                    done += flight.settle(film, background, hits, counters)
        tell(done)


def render_film(
    store: Store,
    camera: Camera,
    *,
    samples: int,
    depth: int,
    capacities: Capacities,
    refine: str,
    fresh_marks: bool,
    scratch: Path,
    stats: Stats,
    report: Report,
) -> Film:
    """Trace one view of a scene.

    Parameters
    ----------
    samples : int
        A pixel; 0 is SPD's procedure.
    depth : int
        Hits of this depth are the last that are shaded; the eye ray's is 1.
    refine : {"base", "sg", "sgb"}
        The paper's refinements.
    """
    film = Film(*camera.resolution, samples)
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
        stats.marks_reused = tracer.marks_reused
        stats.grids.append(tracer.grid)
        eye = view_vectors(camera, store.origin)[0]
        shading = Shading(store, film, eye, capacities)
        rays = EyeRays(store, camera, samples)
        try:
            _depths(tracer, shading, rays, spools, depth, stats, report)
        finally:
            tracer.close()
        stats.bad_rays = tracer.bad
    finally:
        workers.close()
        for spool in spools:
            spool.close()
    return film


def _depths(
    tracer: Tracer,
    shading: Shading,
    eye_rays: EyeRays,
    spools: list[Spool],
    last_depth: int,
    stats: Stats,
    report: Report,
) -> None:
    """The depth loop."""
    hits, waiting, following = spools
    queue: Queue = eye_rays
    depth = 0
    while len(queue):
        depth += 1
        with stats.depth() as counters:
            if depth == 1:
                counters.rays.eye = len(queue)
            tracer.trace(queue, hits, counters, _teller(report, depth, len(queue)))
            with counters.phases.shading.timed():
                following.clear()
                shading.shade(tracer.objects, hits, following, depth >= last_depth, counters)
            for spool in spools:
                counters.phases.shading.spooled(spool)
        hits.clear()
        waiting, following = following, waiting
        queue = waiting


def _teller(report: Report, depth: int, total: int) -> Callable[[int], None]:
    """What turns a count of finished rays into progress, and a False into the end."""

    def tell(done: int) -> None:
        if report(Progress(depth, done, total)) is False:
            raise Cancelled(f"cancelled at depth {depth}, with {done} of {total} rays finished")

    return tell
