"""Rays that start so far away that float64 would lose the scene (exactness rule 6)."""

from libc.math cimport INFINITY, fabs, isfinite

from bfrt.geometry.box cimport Span, slab_axis
from bfrt.geometry.vector cimport Line, Vec, along

# A kernel errs by some units in the last place of the origin, 2^-53 of its distance each: from 2^16
# diagonals that is well below d, 2^-30 of one. (From 2^20 it is not: a wall that a box fits tightly
# would be lost by rule 1.)
cdef enum:
    FAR = 1 << 16  # diagonals
    STAGES = 24    # each takes 52 binary digits off the distance, of the 2100 that there may be

cdef struct Bounds:
    double lo[3]
    double hi[3]
    double diagonal


cdef inline bint is_far(Vec o, const Bounds* b) noexcept nogil:
    cdef double reach = FAR * b.diagonal
    return not (
        fabs(o.x - b.lo[0]) <= reach
        and fabs(o.y - b.lo[1]) <= reach
        and fabs(o.z - b.lo[2]) <= reach
    )


cdef inline bint around_span(const Bounds* b, const Line* l, Span* s) noexcept nogil:
    """Narrow the span to where the line is within a diagonal of the bounds; false for nowhere."""
    cdef double room = b.diagonal
    return (
        slab_axis(b.lo[0] - room, b.hi[0] + room, l.o.x, l.inv.x, s)
        and slab_axis(b.lo[1] - room, b.hi[1] + room, l.o.y, l.inv.y, s)
        and slab_axis(b.lo[2] - room, b.hi[2] + room, l.o.z, l.inv.z, s)
    )


cdef inline double advance_far(Line* l, const Bounds* b) noexcept nogil:
    """Move a far origin along its ray to a diagonal before the bounds; returns the t of the move.

    Not to the bounds themselves: rounding would put the origin behind what lies in them. Where the
    move is so long that its own rounding misses the aim by far, it is done again from there, back
    too.
    """
    cdef Span s
    cdef double moved = 0.0
    s.near = 0.0
    for _ in range(STAGES):
        s.far = INFINITY
        if not (is_far(l.o, b) and around_span(b, l, &s) and isfinite(s.near)):
            break
        l.o = along(l.o, l.d, s.near)
        moved += s.near
        s.near = -INFINITY
    return moved
