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
from numpy.typing import NDArray

from bfrt.budget import Capacities
from bfrt.errors import Cancelled
from bfrt.geometry.lattice import Lattice
from bfrt.image.film import Film
from bfrt.phases.eye import EyeRays, view_vectors
from bfrt.phases.intersection import intersect_all, new_locks
from bfrt.phases.outliers import Outliers
from bfrt.phases.preprocess import lattice_of, preprocess, resolution
from bfrt.phases.shading import Shading
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


class Scheduler:
    """One render of one view.

    Parameters
    ----------
    depth : int
        Hits of this depth are the last that are shaded; the eye ray's is 1.
    """

    def __init__(
        self,
        store: Store,
        camera: Camera,
        *,
        samples: int,
        depth: int,
        capacities: Capacities,
        fresh_marks: bool,
        scratch: Path,
        stats: Stats,
        report: Report,
    ) -> None:
        self._store = store
        self._depth = depth
        self._capacities = capacities
        self._fresh_marks = fresh_marks
        self._scratch = scratch
        self._stats = stats
        self._report = report
        self._background = np.array(store.background, np.float64)
        self._eye_rays = EyeRays(store, camera, samples)
        self.film = Film(*camera.resolution, samples)
        self._shading = Shading(
            store, self.film, view_vectors(camera, store.origin)[0], capacities
        )

    def run(self) -> Film:
        """Trace everything; returns the film."""
        workers = Workers(self._capacities.threads)
        try:
            self._trace_all(workers)
        finally:
            workers.close()
        return self.film

    def _trace_all(self, workers: Workers) -> None:
        (group,) = self._store.groups
        shape = resolution(group.grid_bounds, group.gridded, self._capacities.voxels)
        lattice = lattice_of(self._store, group, shape)
        self._objects = Objects(self._store, group, workers, self._capacities.read_buffer)
        marks = self._preprocess(lattice)
        outliers = Outliers(self._store, group)
        self._voxel_rays = VoxelRays(lattice.shape, self._capacities.candidates)
        self._locks = new_locks()
        self._flight = Flight(self._capacities.rays, lattice, marks, outliers, workers)

        hits = Spool(HIT, self._capacities.hits, self._scratch)
        waiting = Spool(QUEUED, self._capacities.queue, self._scratch)
        following = Spool(QUEUED, self._capacities.queue, self._scratch)
        queue: Queue = self._eye_rays
        for depth in range(1, self._depth + 2):
            with self._stats.depth() as counters:
                if depth == 1:
                    counters.rays.eye = len(queue)
                self._trace(depth, queue, hits, counters)
                with counters.phases.shading.timed():
                    following.clear()
                    last = depth == self._depth
                    self._shading.shade(self._objects, hits, following, last, counters)
                for spool in (hits, waiting, following):
                    counters.phases.shading.spooled(spool)
            hits.clear()
            waiting, following = following, waiting
            queue = waiting
            if not len(queue):
                break
        self._stats.bad_rays += self._flight.bad
        for spool in (hits, waiting, following):
            spool.close()

    def _preprocess(self, lattice: Lattice) -> NDArray[np.uint8]:
        """The marks of the grid, from the store or made now."""
        counters = Counters()
        with counters.phases.preprocess.timed():
            marks, self._stats.marks_reused = preprocess(
                self._store,
                self._objects,
                lattice,
                fresh=self._fresh_marks,
                scratch=self._scratch,
                counters=counters,
            )
        self._stats.total.add(counters)
        return marks

    def _trace(self, depth: int, queue: Queue, hits: Spool, counters: Counters) -> None:
        """Find the nearest hit of every ray in the queue."""
        flight, film, background = self._flight, self.film, self._background
        phases = counters.phases
        total, done = len(queue), 0
        self._tell(Progress(depth, 0, total))
        while len(queue) or flight.active:
            with phases.traversal.timed():
                done += flight.admit(queue, film, background, hits, counters)
                if flight.active:
                    flight.collect(self._voxel_rays, counters)
            if flight.active:
                with phases.intersection.timed():
                    intersect_all(self._objects, flight, self._voxel_rays, self._locks, counters)
                with phases.traversal.timed():
                    done += flight.settle(film, background, hits, counters)
            self._tell(Progress(depth, done, total))

    def _tell(self, progress: Progress) -> None:
        if self._report(progress) is False:
            raise Cancelled(f"cancelled at depth {progress.depth}")
