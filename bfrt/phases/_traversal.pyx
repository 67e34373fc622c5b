"""The ray pool: the memory of rays in flight, and the loops that admit, walk and retire them."""

cimport cython
from libc.math cimport INFINITY
from libc.stdint cimport int64_t, uint8_t, uint16_t, uint32_t, uint64_t
from libc.string cimport memmove

from bfrt.geometry.vector cimport Line
from bfrt.grid.grid cimport Grid
from bfrt.grid.planes cimport NOWHERE
from bfrt.grid.slabs cimport Slab, Slabs
from bfrt.grid.voxel_rays cimport VoxelRays
from bfrt.grid.walk cimport Walk, voxel_enter, walk_resume, walk_start
from bfrt.image.film cimport Film
from bfrt.phases.in_flight cimport RaysInFlight
from bfrt.phases.nearest cimport ray_bad, ray_line
from bfrt.phases.outliers cimport Outliers, meet_outliers
from bfrt.phases.ray_records cimport LIGHT, take_over
from bfrt.phases.slab_walk cimport UNSEEN, Outgoing, flush, slab_of, walk_ray
from bfrt.records cimport NO_HIT, SHADOW, Hit, Queued, Ray

import numpy as np


cdef enum:
    NO_SLAB = 1 << 30  # farther than any


cdef inline void begin(Ray* r, double t, uint64_t id, uint16_t kind) noexcept nogil:
    """Set up a ray that has not yet met the grid."""
    r.t, r.id = t, id
    r.voxel = NOWHERE
    r.kind = <uint8_t>kind
    r.face = 0
    r.lock = 0
    r.state = UNSEEN


cdef inline void come_in(Ray* r, Grid grid, Outliers outliers, int64_t* box_tests,
                         int64_t* object_tests) noexcept nogil:
    """Test a ray against the outliers, and bring it to where it first meets the grid."""
    cdef Line line = ray_line(r)
    cdef Walk w
    if outliers is not None:
        meet_outliers(outliers, r, &line, grid.padding, box_tests, object_tests)
    if walk_start(&w, &grid.planes, &line) and w.enter <= r.t:
        r.voxel = w.voxel
        r.face = <uint8_t>w.face


cdef inline bint descends(const Slab* s, const Ray* r) noexcept nogil:
    """Tell whether a ray goes through the slabs from the last to the first."""
    return (&r.dx)[s.axis] < 0.0


cdef inline int part_of(const Slab* s, const Ray* r, int slabs) noexcept nogil:
    """Return a ray's place in the order of walks through the slabs: up first, then down."""
    cdef int slab = slab_of(s, r)
    return 2 * slabs - 1 - slab if descends(s, r) else slab


@cython.final
cdef class RayPool(RaysInFlight):
    """Holds rays in flight through a grid, and the loops over them.

    Parameters
    ----------
    capacity : int
        Rays at the most.
    candidates : int
        Candidates of all rays together, when there are `capacity` rays.
    """

    cdef uint32_t[::1] order  # which rays, slab by slab
    cdef uint32_t[::1] left   # candidates that each may still take in a pass
    cdef uint64_t[::1] slots
    cdef int64_t used         # of them, in a pass; threads share it
    cdef int64_t ordered      # so many of `order` are as the rays are
    cdef Grid grid            # where rays retire

    def __init__(self, int64_t capacity, int64_t candidates):
        super().__init__(capacity, candidates)
        self.order = np.empty(capacity, np.uint32)
        self.left = np.empty(capacity, np.uint32)

    @property
    def in_flight(self):
        """Return the active rays, (active,) of records.RAY: the same memory."""
        return self.records[:self.active]

    @property
    def room(self):
        """Return the memory that active rays leave free for candidates: (n,) uint64."""
        return self.free()

    def enter_grid(self):
        """Come into another grid, with no ray yet."""
        self.ordered = 0

    def admit(self, const Queued[::1] queued, int64_t first, int64_t last, Grid grid,
              Outliers outliers):
        """Bring queued rays, behind the active ones, to where they first meet the grid.

        Where a ray does not meet it, its voxel is NOWHERE.

        Parameters
        ----------
        queued : (n,) records.QUEUED
            IN.
        first, last : int
            The part of `queued` to do.
        outliers : Outliers or None
            None where all hits are wanted, which `Outliers.cross` finds.

        Returns
        -------
        box_tests, object_tests, bad : int
            Counts; bad rays are NaN, infinite or without direction.
        """
        cdef int64_t i, box_tests = 0, object_tests = 0, bad = 0
        cdef const Queued* q
        cdef Ray* r
        with nogil:
            for i in range(first, last):
                q, r = &queued[i], &self.rays[self.active + i]
                take_over(r, &self.paths[self.active + i], &q.ox, &q.pixel)
                begin(r, LIGHT if q.kind == SHADOW else INFINITY, NO_HIT, q.kind)
                if ray_bad(r):
                    bad += 1
                else:
                    come_in(r, grid, outliers, &box_tests, &object_tests)
        return box_tests, object_tests, bad

    def admit_again(self, const Hit[::1] partial, int64_t first, int64_t last, Grid grid,
                    Outliers outliers):
        """Bring rays that have been through other groups to where they first meet this one's grid.

        Parameters
        ----------
        partial : (n,) records.HIT
            IN. Rays, with the nearest hit so far: t is where a ray ends where it has none.
        first, last, outliers
            As for `admit`, and what is returned.
        """
        cdef int64_t i, box_tests = 0, object_tests = 0
        cdef const Hit* h
        cdef Ray* r
        with nogil:
            for i in range(first, last):
                h, r = &partial[i], &self.rays[self.active + i]
                take_over(r, &self.paths[self.active + i], &h.ox, &h.pixel)
                begin(r, h.t, h.id, h.kind)
                if not ray_bad(r):  # which has been counted
                    come_in(r, grid, outliers, &box_tests, &object_tests)
        return box_tests, object_tests, 0

    def begin_walk(self, int64_t base, uint32_t each):
        """Begin to walk rays from `base` on, to `each` candidates apiece."""
        self.slots = self.room
        self.left[base:self.active] = each
        self.used = 0

    @property
    def stored(self):
        """Return the number of candidates found since `begin_walk`."""
        return self.used

    def keep_order(self):
        """Order the active rays as they are, which is how a single slab walks them."""
        cdef int64_t i
        for i in range(self.ordered, self.active):
            self.order[i] = <uint32_t>i
        self.ordered = max(self.ordered, self.active)

    def arrange(self, int64_t first, Slabs slabs, int64_t[::1] starts):
        """Put rays into the slabs where their walks are (the paper's figure 4).

        Parameters
        ----------
        first : int
            The rays before it are left out.
        starts : (2 slabs + 1,) int64
            OUT. Where each part of the order begins: rays that ascend, slab by slab, then those
            that descend, from the last slab to the first.
        """
        cdef int64_t i, total
        cdef int part, count = slabs.count
        cdef const Slab* s = &slabs.slab
        with nogil:
            starts[:] = 0
            for i in range(first, self.active):
                if self.rays[i].voxel != NOWHERE:
                    starts[part_of(s, &self.rays[i], count) + 1] += 1
            for part in range(2 * count):
                starts[part + 1] += starts[part]
            total = starts[2 * count]
            for i in range(self.active - 1, first - 1, -1):
                if self.rays[i].voxel != NOWHERE:
                    part = part_of(s, &self.rays[i], count)
                    starts[part + 1] -= 1
                    self.order[starts[part + 1]] = <uint32_t>i
            # Each start has sunk to the one before it.
            for part in range(2 * count):
                starts[part] = starts[part + 1]
            starts[2 * count] = total

    def walk(self, int64_t first, int64_t last, Slabs slabs, VoxelRays voxel_rays):
        """Walk the rays [first, last) of the order through the slab that is in memory.

        Candidates go to the room behind the active rays. Where a ray is, (voxel, face), is
        afterwards the first candidate of the next pass, or where it comes into another slab, or
        the voxel is NOWHERE. Those that go on to another slab are, from `first` on, in the order.

        Returns
        -------
        leaving, nearest, steps : int
            Rays that go on to another slab; how many slabs on the nearest of those is; voxels
            stepped to.
        """
        cdef const Slab* s = &slabs.slab
        cdef Outgoing out
        cdef Walk w
        cdef Line line
        cdef Ray* r
        cdef int64_t i, leaving = first, steps = 0
        cdef int nearest = NO_SLAB
        cdef uint32_t ray
        out.n, out.slots, out.used = 0, &self.slots[0], &self.used
        with nogil:
            for i in range(first, last):
                ray = self.order[i]
                r = &self.rays[ray]
                if r.voxel == NOWHERE:
                    continue
                if slab_of(s, r) == s.number:
                    line = ray_line(r)
                    walk_resume(&w, s.planes, &line, r.voxel, r.face)
                    out.ray, out.left = ray, &self.left[ray]
                    steps += walk_ray(s, &w, r, voxel_rays, &out)
                    if r.voxel == NOWHERE or slab_of(s, r) == s.number:
                        continue
                self.order[leaving] = ray
                leaving += 1
                nearest = min(nearest, abs(slab_of(s, r) - s.number))
            flush(&out)
        return leaving - first, nearest, steps

    def close_up(self, const int64_t[::1] firsts, const int64_t[::1] counts, int64_t end):
        """Move parts of the order, ascending, together so that they end at `end`; return where they
        begin."""
        cdef int64_t i
        with nogil:
            for i in range(firsts.shape[0] - 1, -1, -1):
                end -= counts[i]
                memmove(&self.order[end], &self.order[firsts[i]], counts[i] * sizeof(uint32_t))
        return end

    def retire(self, int64_t first, int64_t last, Grid grid, Film film,
               const double[::1] background, Hit[::1] hits):
        """Let complete rays of a part go, as `RaysInFlight.let_go`; threads share the grid."""
        self.grid = grid
        return self.let_go(first, last, film, background, hits)

    cdef bint complete(self, const Ray* r) noexcept nogil:
        cdef Line line
        if r.voxel == NOWHERE:
            return True
        if r.t == INFINITY:
            return False
        line = ray_line(r)
        return r.t < voxel_enter(&self.grid.planes, &line, r.voxel, r.face)
