"""Rays that float64 would lose the scene of: far origins (exactness rule 6), extreme directions."""

from libc.math cimport fabs, fma, frexp, isfinite, ldexp

from bfrt.geometry.outline cimport steepest
from bfrt.geometry.vector cimport Line, Vec, largest, length, vec

# A kernel errs by some units in the last place of the origin, 2^-53 of its distance each: from 2^16
# diagonals that is well below d, 2^-30 of one. (From 2^20 it is not: a wall that a box fits tightly
# would be lost by rule 1.)
cdef enum:
    FAR = 1 << 16  # diagonals
    STAGES = 24    # each takes 52 binary digits off the distance, of the 2100 that there may be
    EXTREME = 64   # binary digits: squares of longer directions, and of shorter, lose something

cdef struct Bounds:
    double lo[3]
    double hi[3]
    double diagonal


cdef inline Bounds bounds_of(const double[:, ::1] corners) noexcept nogil:
    """Return the bounds from corners[0] to corners[1]."""
    cdef Bounds b
    cdef int k
    for k in range(3):
        b.lo[k] = corners[0, k]
        b.hi[k] = corners[1, k]
    b.diagonal = length(vec(b.hi[0] - b.lo[0], b.hi[1] - b.lo[1], b.hi[2] - b.lo[2]))
    return b


cdef inline int scale_extreme(Vec* d) noexcept nogil:
    """Divide an extreme direction by a power of two; return the power, 0 for none.

    Its largest part becomes 1 or more, so that what is divided by it does not overflow. t counts in
    lengths of the direction: it is multiplied by what this has been divided by.
    """
    cdef int power
    cdef double size = largest(d[0])
    if not (size > 0.0 and isfinite(size)):
        return 0
    frexp(size, &power)
    power -= 1
    if -EXTREME <= power <= EXTREME:
        return 0
    d.x, d.y, d.z = ldexp(d.x, -power), ldexp(d.y, -power), ldexp(d.z, -power)
    return power


cdef inline bint is_far(Vec o, const Bounds* b) noexcept nogil:
    cdef double reach = FAR * b.diagonal
    return not (
        fabs(o.x - b.lo[0]) <= reach
        and fabs(o.y - b.lo[1]) <= reach
        and fabs(o.z - b.lo[2]) <= reach
    )


cdef inline double fused(double o, double t, double d) noexcept nogil:
    """Return o + t d, rounded about once, however much of it cancels.

    What is rounded off the product is had by fma, what is rounded off the sum by Knuth's two-sum.
    """
    cdef double p = t * d
    cdef double s = o + p
    cdef double back = s - o
    return s + ((o - (s - back)) + (p - back) + fma(t, d, -p))


cdef inline Vec fused_along(Vec o, double t, Vec d) noexcept nogil:
    return vec(fused(o.x, t, d.x), fused(o.y, t, d.y), fused(o.z, t, d.z))


cdef inline double until_beside(const Line* l, const Bounds* b) noexcept nogil:
    """Return the t at which the line passes the middle of the bounds, along its steepest axis."""
    cdef int k = steepest(l.d)
    return ((b.lo[k] + 0.5 * (b.hi[k] - b.lo[k])) - (&l.o.x)[k]) / (&l.d.x)[k]


cdef inline double before_bounds(const Line* l, const Bounds* b) noexcept nogil:
    """The t at which the line is two diagonals before the middle of the bounds: before all of
    them, which are no farther than 0.87 diagonals along the steepest axis."""
    return until_beside(l, b) - 2.0 * b.diagonal / length(l.d)


cdef inline double advance_far(Line* l, const Bounds* b) noexcept nogil:
    """Move a far origin along its ray to two diagonals before the bounds; return the t of that.

    A t has 53 binary digits, so that of a long move the last is a long way. The move is made as t
    says, rounded once, and what is left is moved again. Then the origin goes back, for it is beside
    the bounds, and rounding may have put it behind what lies in them. A ray that goes away from
    the bounds, or that is beside them nowhere near, stays far: it meets nothing.
    """
    cdef double t, moved = 0.0
    if not is_far(l.o, b) or not until_beside(l, b) > 0.0:
        return 0.0
    for _ in range(STAGES):
        t = until_beside(l, b)
        if not (is_far(l.o, b) and isfinite(moved + t)):
            break
        l.o = fused_along(l.o, t, l.d)
        moved += t
    if is_far(l.o, b):
        return moved
    t = before_bounds(l, b)
    l.o = fused_along(l.o, t, l.d)
    return moved + t
