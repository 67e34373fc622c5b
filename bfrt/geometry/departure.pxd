"""Where rays that go on from a hit begin: off the surface by the hit's error, on one of its sides.

Shading begins its rays so, and `bfrt.cast_rays` tells where others may begin theirs.
"""

from libc.math cimport fabs

from bfrt.geometry.box cimport Box
from bfrt.geometry.far cimport Bounds
from bfrt.geometry.shape cimport Surface
from bfrt.geometry.vector cimport Line, Vec, along, dot, largest

# The side of a surface: that which the ray came from, the other one, that of the object's own
# normal, and the one behind that.
cdef enum Side:
    INCOMING = 0
    OPPOSITE = 1
    FRONT = 2
    BACK = 3


cdef inline double hit_error(const Line* l, double t, Vec p, const Box* b) noexcept nogil:
    """Bound the distance of a computed hit from its surface, with some room.

    Every kernel works on sums of the ray's origin, its way and the object's coordinates, and
    errs by a few units in the last place of the largest; after the idea of error bounds in pbrt
    (Pharr, Jakob and Humphreys, chapter 3.9), in float64, where one bound serves all kinds.
    """
    cdef double reach = largest(l.o) + fabs(t) * largest(l.d) + largest(p)
    cdef int k
    for k in range(3):
        reach += fabs(b.lo[k]) + fabs(b.hi[k])
    return reach * (1.0 / 17592186044416.0)  # 2^-44


cdef inline double world_error(Vec p) noexcept nogil:
    """Bound what rounding moves a point of world coordinates by, on the way there and back.

    The origin of a store is added and taken off again, and a step off the surface is made between:
    each rounds a coordinate by 2^-53 of it at the most.
    """
    return largest(p) * (1.0 / 1125899906842624.0)  # 2^-50


cdef inline double place_error(Vec p, const Bounds* b) noexcept nogil:
    """Bound the distance from its surface of a place that was a hit: p, relative to the store's
    origin, which a ray met that began anywhere in the bounds."""
    cdef double reach = 4.0 * largest(p)
    cdef int k
    for k in range(3):
        reach += 2.0 * (fabs(b.lo[k]) + fabs(b.hi[k]))
    return reach * (1.0 / 17592186044416.0)  # 2^-44


cdef inline bint meets_front(const Surface* s, Vec d) noexcept nogil:
    """Tell whether a ray of direction d, a unit vector, comes from the side of the normal."""
    return dot(s.geometric, d) < 0.0


cdef inline Vec next_origin(const Surface* s, Vec p, Vec d, double error, int side) noexcept nogil:
    """Return p moved off the surface by an error, to a side; d is the ray's direction, unit."""
    cdef bint front = side == FRONT or (side != BACK and meets_front(s, d) == (side == INCOMING))
    return along(p, s.geometric, error if front else -error)
