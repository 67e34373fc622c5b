"""Triangle: three vertices, counterclockwise from outside."""

from libc.math cimport fabs

from bfrt.geometry.box cimport Box, Span, box_between
from bfrt.geometry.coordinates cimport Frame, point
from bfrt.geometry.vector cimport Line, Vec, cross, dot, highest, lowest, sub, unit, vec

cdef struct Triangle:
    Vec a
    Vec b
    Vec c

cdef struct Barycentric:
    double u  # weight of b
    double v  # weight of c


cdef inline bint triangle_load(const unsigned char* record, const Frame* f,
                               Triangle* s) noexcept nogil:
    """Read a record; false if it is degenerate."""
    cdef Vec n
    s.a = point(record, 0, f)
    s.b = point(record, 3, f)
    s.c = point(record, 6, f)
    n = cross(sub(s.b, s.a), sub(s.c, s.a))
    return dot(n, n) > 0.0


cdef inline void triangle_bounds(const Triangle* s, Box* b) noexcept nogil:
    box_between(b, lowest(lowest(s.a, s.b), s.c), highest(highest(s.a, s.b), s.c))


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


cdef inline Vec sheared(Vec p, Vec o, Vec d, int k) noexcept nogil:
    """p seen along the ray: its distance from the ray in x and y, its t in z."""
    cdef Vec q = permuted(sub(p, o), k)
    cdef double t = q.z / d.z
    return vec(q.x - t * d.x, q.y - t * d.y, t)


cdef inline bint triangle_cut(const Triangle* s, const Line* l, double* t,
                              Barycentric* at) noexcept nogil:
    """Where the line meets the triangle, by the watertight test of Woop, Benthin and Wald (2013).

    Each vertex is sheared by the ray alone, so that two triangles agree on a shared edge and no
    ray passes between them. Ours is in float64 throughout, has no second try at higher precision,
    and shears z too, to t.
    """
    cdef int k = steepest(l.d)
    cdef Vec d = permuted(l.d, k)
    cdef Vec a = sheared(s.a, l.o, d, k)
    cdef Vec b = sheared(s.b, l.o, d, k)
    cdef Vec c = sheared(s.c, l.o, d, k)
    cdef double u = c.x * b.y - c.y * b.x
    cdef double v = a.x * c.y - a.y * c.x
    cdef double w = b.x * a.y - b.y * a.x
    cdef double det
    if (u < 0.0 or v < 0.0 or w < 0.0) and (u > 0.0 or v > 0.0 or w > 0.0):
        return False
    det = u + v + w
    if det == 0.0:
        return False
    t[0] = (u * a.z + v * b.z + w * c.z) / det
    at.u = v / det
    at.v = w / det
    return True


cdef inline bint triangle_hit(const Triangle* s, const Line* l, const Span* span,
                              double* t) noexcept nogil:
    cdef Barycentric at
    return triangle_cut(s, l, t, &at) and t[0] > 0.0 and span.near <= t[0] <= span.far


cdef inline Vec triangle_normal(const Triangle* s) noexcept nogil:
    return unit(cross(sub(s.b, s.a), sub(s.c, s.a)))
