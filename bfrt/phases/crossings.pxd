"""Crossings: all hits of rays with an object, not only the nearest, as one thread gathers them."""

from libc.stdint cimport int64_t, uint64_t

from bfrt.geometry.shape cimport BoxHit, Shape, shape_crossings
from bfrt.records cimport Crossing


cdef class CrossingBuffer:
    cdef Crossing[::1] crossings
    cdef object records    # the same memory
    cdef object emit
    cdef int64_t n         # that wait in it


cdef inline int hand_over(CrossingBuffer buffer) except -1 nogil:
    """Hand over the crossings that the buffer holds."""
    if buffer.n:
        with gil:
            buffer.emit(buffer.records[:buffer.n])
        buffer.n = 0
    return 0


cdef inline int cross(CrossingBuffer buffer, const Shape* s, const BoxHit* m, double end,
                      uint64_t id) except -1 nogil:
    """Find where a ray, of which a meeting tells, crosses an object before its end."""
    cdef double t[2]
    cdef Crossing* c
    cdef int k
    for k in range(shape_crossings(s, &m.line, &m.span, &t[0])):
        if t[k] > end:
            break
        if buffer.n == buffer.crossings.shape[0]:
            hand_over(buffer)
        c = &buffer.crossings[buffer.n]
        c.t, c.id, c.ray, c.unused = t[k], id, m.mark, 0
        buffer.n += 1
    return 0
