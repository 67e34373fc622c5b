"""Traversal: each ray's candidate voxels for a pass, and the sentinel that begins its next.

The paper's section 3.2: rays walk to their first candidate before they take memory; in a pass a
ray goes on from there, and the first candidate that it does not take, the sentinel, is found in
the same walk. Walks go slab by slab: those that ascend from the first slab to the last, then those
that descend from the last to the first, so that each slab is read twice at the most.
"""

from __future__ import annotations

from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from bfrt.grid.slabs import Slabs
from bfrt.grid.voxel_rays import VoxelRays
from bfrt.image.film import Film
from bfrt.phases._intersection import Intersector
from bfrt.phases._traversal import RayPool
from bfrt.phases.all_hits import AllHits
from bfrt.phases.outliers import Outliers
from bfrt.records import CANDIDATE_BYTES, HIT, PATH_BYTES, RAY_BYTES
from bfrt.stats import Counters
from bfrt.workers import Workers

#: Candidates of a ray in the pass it enters with (measured: 1 to 4 are equally good).
FIRST_QUOTA = 2

#: Bytes of the scene that are read in about the time that one candidate takes: its walk, its place
#: in the order, its tests (measured from disk on rings of 17 million objects: 90 take 0.87 of the
#: time of 30, 250 take 0.92; on mount of 34 million 90 take 1.1 of the time of 180 or 400).
BYTES_EACH = 180

#: Where a pass reads what is near candidates alone: so many times those that a ray would have had
#: otherwise are the most. Rays that go on long are few and lie apart, and a candidate of theirs may
#: mean to read a hundred times as much as one before (measured on rings of a billion, seen near: 8
#: reads 0.5 GB, 16 0.7, no limit 0.8 or 1.2; on others there is no difference).
LEAP = 8

#: Rays that enter memory at once, and the fewest worth handing to a thread.
ADMITTED = 65536
FEWEST = 512

#: Of the pool: with so many rays in it no more are looked for, where that means to read slabs.
NEARLY_FULL = 0.75

#: The fewest rays in flight that are worth a sweep over the objects.
FEWEST_RAYS = 4096

#: A candidate slot each, four of which a ray gets at the least.
CANDIDATES_A_RAY = 4

#: In flight: the ray, what it is for, its place in its slab, what it may still take, and its
#: candidates.
IN_FLIGHT_BYTES = RAY_BYTES + PATH_BYTES + 4 + 4 + CANDIDATES_A_RAY * CANDIDATE_BYTES

#: Rays that a thread looks at together for whether they are complete.
SETTLED = 8192


class Queue(Protocol):
    """Gives rays that wait: the camera's, or those of a spool."""

    def __len__(self) -> int: ...
    def read(self, most: int) -> NDArray[Any]: ...


class Sink(Protocol):
    """Takes complete rays, from any thread: a spool, or a consumer that takes them at once."""

    def append(self, records: NDArray[Any]) -> None: ...


class Accelerator(NamedTuple):
    """Holds what rays go through in one group: its grid, where they are in it, its outliers."""

    slabs: Slabs
    voxel_rays: VoxelRays
    outliers: Outliers


class Sinks(NamedTuple):
    """Says where complete rays go.

    Attributes
    ----------
    hits : Sink
        Intersections, for the shading; before the last group all rays, for the next one; without a
        film all rays, whether they have met something or not.
    film : Film or None
        The light of shadow rays that met nothing, and the background of others.
    background : ndarray of float64, shape (3,)
    last : bool
        Whether this is the last group.
    """

    hits: Sink
    film: Film | None
    background: NDArray[np.float64]
    last: bool


def quota(least: int, read: int, rays: int, room: int, *, selective: bool) -> int:
    """Return the number of candidates that each ray gets in a pass.

    Few in a ray's first pass, for most rays end soon, and twice as many in each that follows; no
    fewer than a pass is worth that reads so many bytes, but no leap beyond `LEAP` where reading
    follows them; never more than memory holds. So passes grow like a logarithm.

    Parameters
    ----------
    least : int
        Twice the candidates of the pass before, or `FIRST_QUOTA`.
    read : int
        Bytes that a pass reads.
    rays : int
        Number of rays that share the room.
    room : int
        For all candidates, as many as there are rays or more.
    selective : bool
        Whether a pass reads only what is near candidates.
    """
    worth = read // (BYTES_EACH * rays)
    if selective:
        worth = min(worth, LEAP * least)
    return min(max(least, worth), room // rays)


class Traversal:
    """Takes rays through grids: admits, walks and retires them.

    Parameters
    ----------
    capacity : int
        Rays at the most. All memory is taken here.
    candidates : int
        Candidates of all rays together, when there are `capacity` rays.
    workers : Workers

    Attributes
    ----------
    pool : RayPool
        The memory.
    bad : int
        Rays so far that were NaN, infinite or without direction.
    crossings : AllHits, optional
        The receiver of all hits of each ray, if not only the nearest is wanted.
    quota : int
        Candidates that each ray gets in the next pass at the least.
    """

    def __init__(self, capacity: int, candidates: int, workers: Workers) -> None:
        self.pool = RayPool(capacity, candidates)
        self.crossings: AllHits | None = None
        self.bad = 0
        self.quota = FIRST_QUOTA
        self._workers = workers
        self._hits = np.empty((workers.threads, min(capacity, SETTLED)), HIT)

    def begin(self, crossings: AllHits | None) -> None:
        """Begin with a queue of rays, whose nearest hits are wanted, or all."""
        self.crossings = crossings
        if crossings is not None:
            crossings.attach(*self.pool.all)

    def enter(self, accelerator: Accelerator) -> None:
        """Come into a group's grid, with no ray yet."""
        self.grid = accelerator.slabs.grid
        self._slabs, self.voxel_rays, self._outliers = accelerator
        self._starts = np.empty(2 * accelerator.slabs.count + 1, np.int64)
        self.pool.enter_grid()

    def begin_pass(self, intersector: Intersector) -> None:
        """Give the active rays to a worker's intersection loop."""
        crossings = None if self.crossings is None else self.crossings.buffer()
        intersector.begin(self.pool.in_flight, crossings)

    @property
    def active(self) -> int:
        """Return the number of rays in flight."""
        return self.pool.active

    def admit(self, queue: Queue, sinks: Sinks, counters: Counters) -> int:
        """Fill memory from the queue; rays without a candidate are finished, and counted here."""
        pool, finished = self.pool, 0
        if len(queue):
            self.quota = FIRST_QUOTA
        several = self._slabs.count > 1
        while len(queue) and pool.active < pool.capacity:
            base = pool.active
            self._enter(queue, counters)
            while several and len(queue) and pool.active < pool.capacity:
                self._enter(queue, counters)
            self._walk(base, 0, counters)
            finished += self.retire(sinks, counters, base)
            if several and pool.active > NEARLY_FULL * pool.capacity:
                break
        return finished

    def _enter(self, queue: Queue, counters: Counters) -> None:
        """Take rays from the queue, to where they first meet the grid."""
        pool = self.pool
        rays = queue.read(min(ADMITTED, pool.capacity - pool.active))
        come = pool.admit_again if rays.dtype == HIT else pool.admit
        tallies: list[tuple[int, int, int]] = []
        outliers = self._outliers if self.crossings is None else None

        def chunk(_: int, first: int, last: int) -> None:
            tallies.append(come(rays, first, last, self.grid, outliers))
            if self.crossings is not None:
                tests = self._outliers.cross(
                    pool.all[0],
                    pool.active + first,
                    pool.active + last,
                    self.grid.padding,
                    self.crossings.buffer(),
                )
                tallies.append((*tests, 0))

        self._workers.run(chunk, len(rays), smallest=FEWEST)
        pool.come(len(rays))
        for box_tests, object_tests, bad in tallies:
            counters.box_tests += box_tests
            counters.object_tests += object_tests
            self.bad += bad

    def collect(self, read: int, counters: Counters, *, selective: bool) -> None:
        """Store every active ray in its next candidate voxels, as many as `quota` has.

        Parameters
        ----------
        read : int
            Bytes that a pass reads.
        selective : bool
            Whether it reads only what is near candidates.
        """
        room = self.pool.room
        each = quota(self.quota, read, self.active, len(room), selective=selective)
        self.quota = 2 * each
        self._walk(0, each, counters)
        self.voxel_rays.sort(room, self.pool.stored, self._workers)

    def _walk(self, base: int, each: int, counters: Counters) -> None:
        """Walk rays, from `base` on, to their sentinels, past `each` candidates apiece."""
        pool, slabs, starts = self.pool, self._slabs, self._starts
        if slabs.count == 1:
            pool.keep_order()
            starts[:] = base, pool.active, pool.active
        else:
            pool.arrange(base, slabs, starts)
        pool.begin_walk(base, each)
        carried = nearest = 0
        for part in range(2 * slabs.count):
            begin, end = int(starts[part]) - carried, int(starts[part + 1])
            if begin + carried < end or (carried and nearest == part):
                slab = part if part < slabs.count else 2 * slabs.count - 1 - part
                carried, distance = self._walk_slab(slab, begin, end, counters)
                nearest = part + distance
        counters.phases.traversal.bytes_read += slabs.counts()

    def _walk_slab(self, slab: int, begin: int, end: int, counters: Counters) -> tuple[int, int]:
        """Walk the rays of a slab, and bring rays that go on to the end of its part of the order.

        Returns
        -------
        int
            Number of rays that go on.
        int
            Distance, in slabs, to the nearest slab that they go on to.
        """
        pool, slabs = self.pool, self._slabs
        slabs.load(slab)
        parts: list[tuple[int, int]] = []
        tallies: list[tuple[int, int]] = []

        def chunk(_: int, first: int, last: int) -> None:
            first, last = begin + first, begin + last
            leaving, nearest, steps = pool.walk(first, last, slabs, self.voxel_rays)
            parts.append((first, leaving))
            tallies.append((nearest, steps))

        self._workers.run(chunk, end - begin, smallest=FEWEST)
        firsts, counts = np.array(sorted(parts), np.int64).T.copy()
        counters.voxel_steps += sum(steps for _, steps in tallies)
        carried = end - pool.close_up(firsts, counts, end)
        return carried, min(nearest for nearest, _ in tallies)

    def retire(self, sinks: Sinks, counters: Counters, base: int = 0) -> int:
        """Let complete rays go, from `base` on; return how many of them are finished."""
        pool = self.pool
        before = pool.active
        film = sinks.film if sinks.last else None
        parts: list[tuple[int, int]] = []
        tallies: list[tuple[int, int]] = []

        def chunk(worker: int, first: int, last: int) -> None:
            found = self._hits[worker]
            first, last = base + first, base + last
            kept, n, eye_hits = pool.retire(first, last, self.grid, film, sinks.background, found)
            sinks.hits.append(found[:n])
            parts.append((first, kept))
            tallies.append((n, eye_hits))

        self._workers.run(chunk, before - base, smallest=FEWEST, largest=SETTLED)
        if film is not None:
            counters.rays.eye_hits += sum(eye_hits for _, eye_hits in tallies)
        if parts:
            firsts, counts = np.array(sorted(parts), np.int64).T.copy()
            pool.compact(base, firsts, counts)
        passed = 0 if sinks.last else sum(n for n, _ in tallies)
        return before - pool.active - passed
