"""Pending rays: those that have met an object's box, until they are tested against the object."""

from libc.stdint cimport int64_t, uint32_t, uint64_t

from bfrt.geometry.lanes cimport LANES
from bfrt.geometry.shape cimport BoxHit, Shape, shape_meet
from bfrt.phases.crossings cimport CrossingBuffer, cross
from bfrt.phases.nearest cimport nearer
from bfrt.records cimport Ray
from bfrt.scan.given_order cimport GivenOrder
from bfrt.streams.atomic cimport atomic_load, lock, unlock

cdef extern from *:
    """
    #define bfrt_prefetch(p) __builtin_prefetch(p)
    """
    void prefetch "bfrt_prefetch"(const void* p) noexcept nogil

cdef struct Pending:
    Ray* rays               # in flight, of which the pending ones are some
    void* order             # a GivenOrder
    void* crossings         # a CrossingBuffer where all hits are wanted, or NULL: the nearest
    int n
    BoxHit meetings[LANES]
    int64_t tests           # so far


cdef inline void prefetch_ray(const Ray* r) noexcept nogil:
    """Have a ray fetched from memory, which is on two lines of it, while others are looked at."""
    prefetch(&r.ox)
    prefetch(&r.t)


cdef inline int test_pending(Pending* p, const Shape* shape, uint64_t id) except -1 nogil:
    """Intersect an object with the pending rays, and keep the nearest hits, or all."""
    cdef int i
    cdef BoxHit* m
    cdef Ray* r
    p.tests += p.n
    if p.crossings != NULL:
        for i in range(p.n):
            m = &p.meetings[i]
            cross(<CrossingBuffer>p.crossings, shape, m, p.rays[m.mark].t, id)
        p.n = 0
        return 0
    shape_meet(shape, &p.meetings[0], p.n)
    for i in range(p.n):
        m = &p.meetings[i]
        r = &p.rays[m.mark]
        if 0.0 <= m.t <= atomic_load(&r.t):
            lock(&r.lock)
            nearer(r, m.t, id, <GivenOrder>p.order)
            unlock(&r.lock)
    p.n = 0
    return 0
