"""Outlines as a ray sees them: on which side of an edge it passes, the same for all faces there.

::

    vertex p ──► its offset from the ray in x and y, its depth in z: the ray is the z axis
                    y
        a ×─────────┼──× b     an edge decides by the sign of a x b, which is that of
                 \\  │ /       b x a turned round, to the last bit; where rounding makes
                  \\ ray ─ x    it 0 it is worked out without rounding

A vertex is sheared by the ray alone, after Woop, Benthin and Wald, "Watertight ray/triangle
intersection" (2013). Theirs divides by the direction's largest component once for each ray, is in
float32, and tries again in float64 where a product difference is 0; ours divides nothing (offsets
are multiples of that component), is in float64, and exact at 0. So all faces that share a vertex
have it in one place, all that share an edge have the ray on one side of it, and whatever their
planes are no ray passes between them.

A ray that meets an edge or a corner exactly is counted by one face only (``edge_crossed``): as if
it passed a hair beside it, beyond the edge in x, and by less in y. Only exact signs make that hold.
"""

from libc.math cimport fabs, fma

from bfrt.geometry.vector cimport Line, Vec, sub, vec

cdef struct Shear:
    Vec o
    Vec d   # turned so that its largest component comes last
    int k   # the axis of that component


cdef inline Vec permuted(Vec p, int k) noexcept nogil:
    """Return the components, turned so that axis k comes last."""
    if k == 0:
        return vec(p.y, p.z, p.x)
    if k == 1:
        return vec(p.z, p.x, p.y)
    return p


cdef inline int steepest(Vec d) noexcept nogil:
    """Return the axis of the largest magnitude."""
    if fabs(d.x) >= fabs(d.y) and fabs(d.x) >= fabs(d.z):
        return 0
    return 1 if fabs(d.y) >= fabs(d.z) else 2


cdef inline Shear shear_along(const Line* l) noexcept nogil:
    """Compute how a ray shears vertices, so that it becomes the z axis."""
    cdef Shear s
    s.o = l.o
    s.k = steepest(l.d)
    s.d = permuted(l.d, s.k)
    return s


cdef inline Vec sheared(const Shear* s, Vec p) noexcept nogil:
    """Return p as seen along the ray: its offset from it in x and y, times d.z; its depth in z."""
    cdef Vec q = permuted(sub(p, s.o), s.k)
    return vec(q.x * s.d.z - q.z * s.d.x, q.y * s.d.z - q.z * s.d.y, q.z)


cdef inline double edge_side(Vec a, Vec b) noexcept nogil:
    """Return a x b, of exact sign: above 0 where the edge has the ray on its left, 0 on it.

    A difference of rounded products has the right sign or is 0. Then the products are equal, and
    what was rounded off decides (Dekker's product, by fma, which rounds once on any machine).
    """
    cdef double one = a.x * b.y
    cdef double two = a.y * b.x
    if one != two:
        return one - two
    return fma(a.x, b.y, -one) - fma(a.y, b.x, -two)


cdef inline bint edge_crossed(Vec a, Vec b, double side) noexcept nogil:
    """Tell whether an edge with this `edge_side` crosses the x axis beyond the ray.

    A point on the axis counts as below it, the ray on an edge as beyond that: so each edge decides
    alike whichever way it is walked, and a face owns the ray where an odd number of its edges are
    crossed.
    """
    if (a.y > 0.0) == (b.y > 0.0):
        return False
    return side > 0.0 if b.y > a.y else side < 0.0


cdef inline bint edge_met(Vec a, Vec b, double side) noexcept nogil:
    """Tell whether the ray meets an edge with this `edge_side`, its ends included."""
    return side == 0.0 and a.x * b.x <= 0.0 and a.y * b.y <= 0.0
