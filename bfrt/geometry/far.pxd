"""Rays that start so far away that float64 would lose the scene (exactness rule 6)."""

from libc.math cimport INFINITY, fabs

from bfrt.geometry.box cimport Span, slab_axis
from bfrt.geometry.vector cimport Line, along

cdef enum:
    FAR = 1 << 20  # diagonals

cdef struct Bounds:
    double lo[3]
    double hi[3]
    double diagonal


cdef inline double advance_far(Line* l, const Bounds* b) noexcept nogil:
    """Move a far origin along its ray to the scene's bounds; returns the t it has moved by."""
    cdef Span s
    cdef double reach = FAR * b.diagonal
    cdef double x = fabs(l.o.x - b.lo[0])
    cdef double y = fabs(l.o.y - b.lo[1])
    cdef double z = fabs(l.o.z - b.lo[2])
    if x <= reach and y <= reach and z <= reach:
        return 0.0
    s.near = 0.0
    s.far = INFINITY
    if not (
        slab_axis(b.lo[0], b.hi[0], l.o.x, l.inv.x, &s)
        and slab_axis(b.lo[1], b.hi[1], l.o.y, l.inv.y, &s)
        and slab_axis(b.lo[2], b.hi[2], l.o.z, l.inv.z, &s)
    ):
        return 0.0
    l.o = along(l.o, l.d, s.near)
    return s.near
