"""Outlines as a ray sees them: on which side of an edge it passes, the same for all faces there.

::

    vertex p ──► its distance from the ray in x and y, its t in z: the ray is the z axis
                    y
        a ×─────────┼──× b     an edge decides by the sign of a x b, which is that of
                 \\  │ /       b x a turned round, to the last bit; where rounding makes
                  \\ ray ─ x    it 0 it is worked out without rounding

A vertex is sheared by the ray alone, after Woop, Benthin and Wald, "Watertight ray/triangle
intersection" (2013). Theirs is in float32, tries again in float64 where a product difference is 0,
and leaves z to the end; ours is in float64, exact at 0, and shears z to t. So all faces that share
a vertex have it in one place, all that share an edge have the ray on one side of it, and whatever
their planes are no ray passes between them.

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
    """The components, turned so that axis k comes last."""
    if k == 0:
        return vec(p.y, p.z, p.x)
    if k == 1:
        return vec(p.z, p.x, p.y)
    return p


cdef inline int steepest(Vec d) noexcept nogil:
    """The axis of the largest magnitude."""
    if fabs(d.x) >= fabs(d.y) and fabs(d.x) >= fabs(d.z):
        return 0
    return 1 if fabs(d.y) >= fabs(d.z) else 2


cdef inline Shear shear_along(const Line* l) noexcept nogil:
    """How vertices are sheared by a ray."""
    cdef Shear s
    s.o = l.o
    s.k = steepest(l.d)
    s.d = permuted(l.d, s.k)
    return s


cdef inline Vec sheared(const Shear* s, Vec p) noexcept nogil:
    """p seen along the ray: its distance from the ray in x and y, its t in z."""
    cdef Vec q = permuted(sub(p, s.o), s.k)
    cdef double t = q.z / s.d.z
    return vec(q.x - t * s.d.x, q.y - t * s.d.y, t)


cdef inline double edge_side(Vec a, Vec b) noexcept nogil:
    """a x b, of the right sign: above 0 where the edge has the ray on its left, 0 on its line.

    A difference of rounded products has the right sign or is 0. Then the products are equal, and
    what was rounded off decides (Dekker's product, by fma, which rounds once on any machine).
    """
    cdef double one = a.x * b.y
    cdef double two = a.y * b.x
    if one != two:
        return one - two
    return fma(a.x, b.y, -one) - fma(a.y, b.x, -two)


cdef inline bint edge_crossed(Vec a, Vec b, double side) noexcept nogil:
    """Whether an edge, of that side, crosses the x axis beyond the ray.

    A point on the axis counts as below it, the ray on an edge as beyond that: so each edge decides
    alike whichever way it is walked, and a face owns the ray where an odd number of its edges are
    crossed.
    """
    if (a.y > 0.0) == (b.y > 0.0):
        return False
    return side > 0.0 if b.y > a.y else side < 0.0


cdef inline bint edge_met(Vec a, Vec b, double side) noexcept nogil:
    """Whether the ray meets an edge, of that side, its ends included."""
    return side == 0.0 and a.x * b.x <= 0.0 and a.y * b.y <= 0.0
