"""All hits of rays with an object, not only the nearest: gathered, and handed over."""

from libc.stdint cimport int64_t, uint32_t, uint64_t

from bfrt.geometry.shape cimport BoxHit, Shape, shape_crossings
from bfrt.records cimport Crossing

# One thread's crossings; `emit` is a Python callable, which the caller keeps alive.
cdef struct Found:
    Crossing* crossings
    int64_t n
    int64_t room
    void* emit


cdef inline int hand_over(Found* f) except -1 nogil:
    """Hand over the crossings that the buffer holds."""
    if f.n:
        with gil:
            (<object>f.emit)(f.n)
        f.n = 0
    return 0


cdef inline int cross(Found* f, const Shape* s, const BoxHit* m, double end,
                      uint64_t id) except -1 nogil:
    """Find where a ray, of which a meeting tells, crosses an object before its end."""
    cdef double t[2]
    cdef Crossing* c
    cdef int k
    for k in range(shape_crossings(s, &m.line, &m.span, &t[0])):
        if t[k] > end:
            break
        if f.n == f.room:
            hand_over(f)
        c = &f.crossings[f.n]
        c.t, c.id, c.ray, c.unused = t[k], id, m.mark, 0
        f.n += 1
    return 0
