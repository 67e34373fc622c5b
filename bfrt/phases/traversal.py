"""Traversal: each ray's candidate voxels for a pass, and the sentinel that begins its next.

The paper's section 3.2: rays walk to their first candidate before they take memory; in a pass a
ray goes on from there, and the first candidate that it does not take, the sentinel, is found in
the same walk.
"""

from __future__ import annotations

from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from bfrt.geometry.lattice import Lattice
from bfrt.image.film import Film
from bfrt.phases._traversal import admit, close_ranks, collect, settle
from bfrt.phases.outliers import Outliers
from bfrt.phases.voxel_rays import VoxelRays
from bfrt.records import HIT, PATH, RAY
from bfrt.stats import Counters
from bfrt.streams.spool import Spool
from bfrt.workers import Workers

#: Candidates of a ray in the pass it enters with (measured: 1 to 4 are equally good).
FIRST_QUOTA = 2

#: Objects swept in about the time that one candidate's tests take.
SWEPT_EACH = 32

#: Rays that enter memory at once, and the fewest worth handing to a thread.
ADMITTED = 65536
FEWEST = 512

#: Rays that a thread looks at together for whether they are complete.
SETTLED = 8192


class Queue(Protocol):
    """Rays that wait: the camera's, or a spool."""

    def __len__(self) -> int: ...
    def read(self, most: int) -> NDArray[Any]: ...


class Flight:
    """Rays in flight: what is in memory, of one group.

    Parameters
    ----------
    capacity : int
        Rays at the most. All memory is taken here.
    """

    def __init__(
        self,
        capacity: int,
        lattice: Lattice,
        marks: NDArray[np.uint8],
        outliers: Outliers,
        workers: Workers,
    ) -> None:
        self.lattice = lattice
        self.active = 0
        self.bad = 0
        self._quota = FIRST_QUOTA
        self._marks = marks
        self._outliers = outliers
        self._workers = workers
        self._rays = np.empty(capacity, RAY)
        self._paths = np.empty(capacity, PATH)
        self._hits = np.empty((workers.threads, min(capacity, SETTLED)), HIT)

    @property
    def rays(self) -> NDArray[Any]:
        """The active rays, records.RAY."""
        return self._rays[: self.active]

    def admit(
        self,
        queue: Queue,
        film: Film,
        background: NDArray[np.float64],
        hits: Spool,
        counters: Counters,
    ) -> int:
        """Fill memory from the queue; rays without a candidate are finished, and counted here."""
        finished = 0
        if len(queue):
            self._quota = FIRST_QUOTA
        tallies: list[tuple[int, int, int, int]] = []
        while len(queue) and self.active < len(self._rays):
            base = self.active
            rays = queue.read(min(ADMITTED, len(self._rays) - base))

            def chunk(
                _: int, first: int, last: int, rays: NDArray[Any] = rays, base: int = base
            ) -> None:
                tally = admit(
                    rays,
                    self._rays,
                    self._paths,
                    base,
                    first,
                    last,
                    self.lattice,
                    self._marks,
                    self._outliers,
                )
                tallies.append(tally)

            self._workers.run(chunk, len(rays), smallest=FEWEST)
            self.active += len(rays)
            finished += self.settle(film, background, hits, counters, base)
        for steps, box_tests, object_tests, bad in tallies:
            counters.voxel_steps += steps
            counters.box_tests += box_tests
            counters.object_tests += object_tests
            self.bad += bad
        return finished

    def collect(self, voxel_rays: VoxelRays, objects: int, counters: Counters) -> None:
        """Store every active ray in its next candidate voxels.

        Few in a ray's first pass, for most rays end soon, and twice as many in each that follows;
        no fewer than a sweep over so many objects is worth, never more than memory holds. So
        passes grow like a logarithm.
        """
        slots = voxel_rays.slots
        worth = max(self._quota, objects // (SWEPT_EACH * self.active))
        quota = max(1, min(worth, len(slots) // self.active))
        self._quota *= 2
        segments: list[tuple[int, int, int]] = []

        def chunk(_: int, first: int, last: int) -> None:
            found, steps = collect(self._rays, first, last, self.lattice, self._marks, quota, slots)
            segments.append((first * quota, found, steps))

        self._workers.run(chunk, self.active, smallest=FEWEST)
        firsts, counts, steps = np.array(sorted(segments), np.int64).T.copy()
        counters.voxel_steps += int(steps.sum())
        voxel_rays.sort(firsts, counts, self._workers)

    def settle(
        self,
        film: Film,
        background: NDArray[np.float64],
        hits: Spool,
        counters: Counters,
        base: int = 0,
    ) -> int:
        """Let complete rays go, from `base` on: intersections to `hits`, light to the film."""
        before = self.active
        parts: list[tuple[int, int]] = []

        def chunk(worker: int, first: int, last: int) -> None:
            found = self._hits[worker]
            first, last = base + first, base + last
            kept, n, eye_hits = settle(
                self._rays, self._paths, first, last, self.lattice, film, background, found
            )
            hits.append(found[:n])
            parts.append((first, kept))
            tallies.append(eye_hits)

        tallies: list[int] = []
        self._workers.run(chunk, before - base, smallest=FEWEST, largest=SETTLED)
        counters.rays.eye_hits += sum(tallies)
        if parts:
            firsts, counts = np.array(sorted(parts), np.int64).T.copy()
            self.active = close_ranks(self._rays, self._paths, base, firsts, counts)
        return before - self.active
