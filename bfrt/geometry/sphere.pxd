"""Sphere: center and radius. A negative radius turns the normal inwards."""

from libc.math cimport INFINITY, fabs, sqrt

from bfrt.geometry.box cimport Box, Span, box_between
from bfrt.geometry.coordinates cimport Frame, number, point
from bfrt.geometry.packet cimport BOXES, BoxPacket, eight_below, eight_clear, eight_end
from bfrt.geometry.vector cimport Line, Vec, along, dot, larger, scale, smaller, sub, vec

cdef struct Sphere:
    Vec c
    double r


cdef inline bint sphere_load(const unsigned char* record, const Frame* f, Sphere* s) noexcept nogil:
    """Read a record; false if it is degenerate."""
    s.c = point(record, 0, f)
    s.r = number(record, 3, f.wide)
    return s.r != 0.0


cdef inline void sphere_bounds(const Sphere* s, Box* b) noexcept nogil:
    cdef double r = fabs(s.r)
    box_between(b, vec(s.c.x - r, s.c.y - r, s.c.z - r), vec(s.c.x + r, s.c.y + r, s.c.z + r))


cdef inline void sphere_boxes(const unsigned char* records, size_t stride, const Frame* f, int n,
                              BoxPacket* e) noexcept nogil:
    """Compute the boxes of n spheres, BOXES or fewer, as `sphere_bounds` does; else empty."""
    cdef double side[6][BOXES]  # of the high ones the negative, so that all are rounded down
    cdef Sphere s[BOXES]
    cdef double r
    cdef int i, k
    for i in range(BOXES):
        sphere_load(records + (i if i < n else 0) * stride, f, &s[i])
    for i in range(BOXES):
        r = fabs(s[i].r)
        side[0][i], side[3][i] = s[i].c.x - r, -(s[i].c.x + r)
        side[1][i], side[4][i] = s[i].c.y - r, -(s[i].c.y + r)
        side[2][i], side[5][i] = s[i].c.z - r, -(s[i].c.z + r)
    eight_below(&side[0][0], &e.side[0][0])
    for k in range(3, 6):
        for i in range(BOXES):
            e.side[k][i] = -e.side[k][i]
    for i in range(n):
        if s[i].r == 0.0:
            eight_clear(e, i)
    eight_end(e, n)


cdef inline void sphere_union(const unsigned char* records, size_t stride, const Frame* f, int n,
                              Box* all) noexcept nogil:
    """Compute the box around n spheres, one or more, degenerate ones too. Rounding it once gives
    what rounding each box gives, since rounding keeps numbers in order.
    """
    cdef Vec lo = vec(INFINITY, INFINITY, INFINITY)
    cdef Vec hi = vec(-INFINITY, -INFINITY, -INFINITY)
    cdef Sphere s
    cdef double r
    cdef int i
    for i in range(n):
        sphere_load(records + i * stride, f, &s)
        r = fabs(s.r)
        lo = vec(smaller(s.c.x - r, lo.x), smaller(s.c.y - r, lo.y), smaller(s.c.z - r, lo.z))
        hi = vec(larger(s.c.x + r, hi.x), larger(s.c.y + r, hi.y), larger(s.c.z + r, hi.z))
    box_between(all, lo, hi)


cdef inline bint sphere_missed(const unsigned char* record, const Frame* f,
                               const Line* l) noexcept nogil:
    """Tell whether a line misses a record's sphere, as `sphere_roots` does."""
    cdef Vec co = sub(l.o, point(record, 0, f))
    cdef double r = number(record, 3, f.wide)
    cdef Vec nearest = along(co, l.d, -dot(co, l.d) / dot(l.d, l.d))
    return not r * r - dot(nearest, nearest) >= 0.0


cdef inline bint sphere_roots(const Sphere* s, const Line* l, double* roots) noexcept nogil:
    """Find where the line meets the surface, the smaller root first; false for nowhere.

    The discriminant is taken at the closest approach to the center, not as b^2 - 4ac, which
    cancels for a small sphere far away (Haines et al., Ray Tracing Gems, chapter 7). The product
    of the roots then gives the one that subtraction would spoil.
    """
    cdef Vec co = sub(l.o, s.c)
    cdef double a = dot(l.d, l.d)
    cdef double b = -dot(co, l.d)
    cdef Vec nearest = along(co, l.d, b / a)
    cdef double disc = s.r * s.r - dot(nearest, nearest)
    cdef double q, near, far, root
    if not disc >= 0.0:
        return False
    root = sqrt(disc * a)
    q = b + root if b >= 0.0 else b - root
    near = (dot(co, co) - s.r * s.r) / q if q != 0.0 else 0.0
    far = q / a
    if near > far:
        near, far = far, near
    roots[0], roots[1] = near, far
    return True


cdef inline bint sphere_hit(const Sphere* s, const Line* l, const Span* span,
                            double* t) noexcept nogil:
    """Find the smallest root in the span."""
    cdef double roots[2]
    cdef int k
    if not sphere_roots(s, l, &roots[0]):
        return False
    for k in range(2):
        if roots[k] > 0.0 and span.near <= roots[k] <= span.far:
            t[0] = roots[k]
            return True
    return False


cdef inline int sphere_crossings(const Sphere* s, const Line* l, const Span* span,
                                 double* t) noexcept nogil:
    """Find all roots in the span, up to two, ascending; return how many. A tangent has one."""
    cdef double roots[2]
    cdef int k, n = 0
    if not sphere_roots(s, l, &roots[0]):
        return 0
    for k in range(1 if roots[0] == roots[1] else 2):
        if roots[k] > 0.0 and span.near <= roots[k] <= span.far:
            t[n] = roots[k]
            n += 1
    return n


cdef inline Vec sphere_normal(const Sphere* s, Vec p) noexcept nogil:
    return scale(sub(p, s.c), 1.0 / s.r)
