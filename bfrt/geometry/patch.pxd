"""Patch: a triangle with a normal at each vertex, for smooth shading."""

from bfrt.geometry.coordinates cimport Frame, direction
from bfrt.geometry.triangle cimport Barycentric, Triangle, triangle_load, triangle_normal
from bfrt.geometry.vector cimport Vec, add, dot, scale, unit

cdef struct Patch:
    Triangle face
    Vec na
    Vec nb
    Vec nc


cdef inline bint patch_load(const unsigned char* record, const Frame* f, Patch* s) noexcept nogil:
    """Read a record; false if it is degenerate."""
    s.na = direction(record, 9, f)
    s.nb = direction(record, 12, f)
    s.nc = direction(record, 15, f)
    return triangle_load(record, f, &s.face)


cdef inline Vec patch_normal(const Patch* s, const Barycentric* at) noexcept nogil:
    """Return the interpolated normal, or the face's where the vertices' cancel."""
    cdef Vec n = add(
        scale(s.na, 1.0 - at.u - at.v), add(scale(s.nb, at.u), scale(s.nc, at.v))
    )
    return unit(n) if dot(n, n) > 0.0 else triangle_normal(&s.face)
