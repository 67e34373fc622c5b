"""The nearest hit of a ray: the lexicographic minimum of (t, id), updated as one value."""

from libc.math cimport isfinite
from libc.stdint cimport uint64_t

from bfrt.geometry.vector cimport Line, line, vec
from bfrt.records cimport NO_HIT, SHADOW, Ray
from bfrt.scan.given_order cimport GivenOrder, comes_first


cdef inline Line ray_line(const Ray* r) noexcept nogil:
    return line(vec(r.ox, r.oy, r.oz), vec(r.dx, r.dy, r.dz))


cdef inline bint ray_bad(const Ray* r) noexcept nogil:
    """Tell whether a ray is NaN, infinite or without direction: it hits nothing, and is counted."""
    return not (
        isfinite(r.ox) and isfinite(r.oy) and isfinite(r.oz)
        and isfinite(r.dx) and isfinite(r.dy) and isfinite(r.dz)
        and r.dx * r.dx + r.dy * r.dy + r.dz * r.dz > 0.0
    )


cdef inline void nearer(Ray* r, double t, uint64_t id, GivenOrder order) noexcept nogil:
    """Take a hit if it is nearer than the one so far; of two at one t, the object given first.

    Any hit is enough for a shadow ray: t = -1 then keeps it from every further test.
    """
    if t < r.t or (t == r.t and (r.id == NO_HIT or comes_first(order, id, r.id))):
        r.t = -1.0 if r.kind == SHADOW else t
        r.id = id
