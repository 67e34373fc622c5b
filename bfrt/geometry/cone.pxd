"""Cone and cylinder: two discs, the surface between them, no caps.

A negative radius turns the normal inwards; the two radii have one sign.
"""

from libc.math cimport fabs, sqrt

from bfrt.geometry.box cimport Box, Span, box_between
from bfrt.geometry.coordinates cimport Frame, number, point
from bfrt.geometry.vector cimport (
    Line, Vec, add, along, cross, dot, highest, lowest, scale, sub, vec,
)

cdef struct Cone:
    Vec base
    Vec axis         # from base to apex
    double length2   # of the axis, squared
    double rb        # |radius| at the base
    double dr        # |radius| at the apex, less that
    double side      # -1 where the normal points inwards


cdef inline bint cone_load(const unsigned char* record, const Frame* f, Cone* c) noexcept nogil:
    """Read a record; false if it is degenerate."""
    cdef double rb = number(record, 3, f.wide)
    cdef double ra = number(record, 7, f.wide)
    c.base = point(record, 0, f)
    c.axis = sub(point(record, 4, f), c.base)
    c.length2 = dot(c.axis, c.axis)
    c.rb = fabs(rb)
    c.dr = fabs(ra) - c.rb
    c.side = -1.0 if rb < 0.0 or ra < 0.0 else 1.0
    return c.length2 > 0.0 and (rb != 0.0 or ra != 0.0)


cdef inline void cone_bounds(const Cone* c, Box* b) noexcept nogil:
    """Compute the box of the two discs: r sin(angle to the axis) either way of a center.

    The sine comes from the other two components: 1 - cos^2 would lose half its digits.
    """
    cdef double x2 = c.axis.x * c.axis.x / c.length2
    cdef double y2 = c.axis.y * c.axis.y / c.length2
    cdef double z2 = c.axis.z * c.axis.z / c.length2
    cdef Vec wide = vec(sqrt(y2 + z2), sqrt(x2 + z2), sqrt(x2 + y2))
    cdef Vec apex = add(c.base, c.axis), rb = scale(wide, c.rb), ra = scale(wide, c.rb + c.dr)
    box_between(b, lowest(sub(c.base, rb), sub(apex, ra)), highest(add(c.base, rb), add(apex, ra)))


cdef inline bint cone_root(double t, double shift, double s0, double ds, const Span* span,
                           double* found) noexcept nogil:
    """Take the root t, counted from `shift`, if it is between the discs and in the span."""
    cdef double s = s0 + t * ds
    t += shift
    if 0.0 <= s <= 1.0 and t > 0.0 and span.near <= t <= span.far:
        found[0] = t
        return True
    return False


# Where a line meets a cone that has no ends: its roots, the smaller first, counted from `shift`,
# and where the way along the axis begins (0 at the base, 1 at the apex) and how it grows.
cdef struct ConeRoots:
    double roots[2]
    double shift
    double s0
    double ds


cdef inline bint cone_roots(const Cone* c, const Line* l, ConeRoots* r) noexcept nogil:
    """Find the roots; false where there is none.

    With p and v the parts of position and direction across the axis, and r and r' the radius and
    its change along the ray, the surface is |p + t v| = r + t r'. Its discriminant
    (p.v - r r')^2 - (v^2 - r'^2)(p^2 - r^2) is |r v - r' p|^2 - |p x v|^2, which does not cancel;
    it is taken where the ray is closest to the middle of the axis, so that a cone far away keeps
    its digits.
    """
    cdef Vec co = sub(l.o, c.base)
    cdef double shift = dot(sub(scale(c.axis, 0.5), co), l.d) / dot(l.d, l.d)
    cdef Vec o = along(co, l.d, shift)
    cdef double s0 = dot(o, c.axis) / c.length2
    cdef double ds = dot(l.d, c.axis) / c.length2
    cdef Vec p = along(o, c.axis, -s0)
    cdef Vec v = along(l.d, c.axis, -ds)
    cdef double r0 = c.rb + s0 * c.dr
    cdef double dr = ds * c.dr
    cdef Vec turned = sub(scale(v, r0), scale(p, dr))
    cdef Vec moment = cross(p, v)
    cdef double disc = dot(turned, turned) - dot(moment, moment)
    cdef double a, b, q, first, second
    if not disc >= 0.0:
        return False
    a = dot(v, v) - dr * dr
    b = dot(p, v) - r0 * dr
    q = -(b + sqrt(disc)) if b >= 0.0 else sqrt(disc) - b
    # Where a (or q) is 0 the root is infinite (or NaN), and fails every test below.
    first = q / a
    second = (dot(p, p) - r0 * r0) / q
    if second < first:
        first, second = second, first
    r.roots[0], r.roots[1] = first, second
    r.shift, r.s0, r.ds = shift, s0, ds
    return True


cdef inline bint cone_hit(const Cone* c, const Line* l, const Span* span,
                          double* t) noexcept nogil:
    """Find the smallest root in the span that lies between the discs."""
    cdef ConeRoots r
    return cone_roots(c, l, &r) and (
        cone_root(r.roots[0], r.shift, r.s0, r.ds, span, t)
        or cone_root(r.roots[1], r.shift, r.s0, r.ds, span, t)
    )


cdef inline int cone_crossings(const Cone* c, const Line* l, const Span* span,
                               double* t) noexcept nogil:
    """Find all crossings, up to two, ascending; return how many. A tangent has one."""
    cdef ConeRoots r
    cdef int n = 0
    if not cone_roots(c, l, &r):
        return 0
    n += cone_root(r.roots[0], r.shift, r.s0, r.ds, span, &t[n])
    if r.roots[0] != r.roots[1]:
        n += cone_root(r.roots[1], r.shift, r.s0, r.ds, span, &t[n])
    return n


cdef inline Vec cone_normal(const Cone* c, Vec p) noexcept nogil:
    """Return the normal: across the axis, leaning to the narrow end; the axis itself at an apex."""
    cdef Vec q = sub(p, c.base)
    cdef double s = dot(q, c.axis) / c.length2
    cdef Vec out = along(q, c.axis, -s)
    cdef double across = sqrt(dot(out, out))
    cdef Vec n
    if across == 0.0:
        n = scale(c.axis, 1.0 if c.dr < 0.0 else -1.0)
    else:
        n = along(scale(out, 1.0 / across), c.axis, -c.dr / c.length2)
    return scale(n, c.side / sqrt(dot(n, n)))
