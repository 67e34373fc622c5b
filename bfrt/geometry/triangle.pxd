"""Triangle: three vertices, counterclockwise from outside."""

from bfrt.geometry.box cimport Box, Span, box_between
from bfrt.geometry.coordinates cimport Frame, point
from bfrt.geometry.outline cimport Shear, edge_crossed, edge_side, shear_along, sheared
from bfrt.geometry.vector cimport (
    Line, Vec, add, cross, dot, highest, larger, lowest, scale, smaller, sub, unit,
)

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


cdef inline bint triangle_cut(const Triangle* s, const Line* l, double* t,
                              Barycentric* at) noexcept nogil:
    """Find where the line meets the triangle, edges and corners included (outline.pxd)."""
    cdef Shear seen = shear_along(l)
    cdef Vec a = sheared(&seen, s.a)
    cdef Vec b = sheared(&seen, s.b)
    cdef Vec c = sheared(&seen, s.c)
    cdef double u = edge_side(c, b)
    cdef double v = edge_side(a, c)
    cdef double w = edge_side(b, a)
    cdef double det
    if (u < 0.0 or v < 0.0 or w < 0.0) and (u > 0.0 or v > 0.0 or w > 0.0):
        return False
    det = u + v + w
    if det == 0.0:
        return False
    t[0] = (u * a.z + v * b.z + w * c.z) / (det * seen.d.z)
    at.u = v / det
    at.v = w / det
    return True


cdef inline bint triangle_missed(const unsigned char* record, const Frame* f,
                                 const Shear* seen) noexcept nogil:
    """Tell whether a ray misses a record's triangle by its edges alone, as `triangle_cut` does."""
    cdef Vec a = sheared(seen, point(record, 0, f))
    cdef Vec b = sheared(seen, point(record, 3, f))
    cdef Vec c = sheared(seen, point(record, 6, f))
    cdef double u = edge_side(c, b)
    cdef double v = edge_side(a, c)
    cdef double w = edge_side(b, a)
    return (u < 0.0 or v < 0.0 or w < 0.0) and (u > 0.0 or v > 0.0 or w > 0.0)


cdef inline bint triangle_hit(const Triangle* s, const Line* l, const Span* span,
                              double* t) noexcept nogil:
    """Tell whether the line meets the triangle beyond its origin.

    It does so within the span, if it does, but for the rounding of t, which of a sliver is more
    than boxes have room for: t is brought into the span, and no ray passes for that.
    """
    cdef Barycentric at
    if not triangle_cut(s, l, t, &at):
        return False
    t[0] = smaller(larger(t[0], span.near), span.far)
    return t[0] > 0.0


cdef inline bint triangle_crossed(const Triangle* s, const Line* l, const Span* span,
                                  double* t) noexcept nogil:
    """Tell whether the triangle owns the hit: at a shared edge or corner just one does."""
    cdef Shear seen
    cdef Vec a, b, c
    if not triangle_hit(s, l, span, t):
        return False
    seen = shear_along(l)
    a, b, c = sheared(&seen, s.a), sheared(&seen, s.b), sheared(&seen, s.c)
    return (
        edge_crossed(a, b, edge_side(a, b))
        ^ edge_crossed(b, c, edge_side(b, c))
        ^ edge_crossed(c, a, edge_side(c, a))
    )


cdef inline Vec triangle_place(const Triangle* s, const Barycentric* at) noexcept nogil:
    """Return the point of these weights: on the triangle within rounding, however thin it is."""
    return add(s.a, add(scale(sub(s.b, s.a), at.u), scale(sub(s.c, s.a), at.v)))


cdef inline Vec triangle_normal(const Triangle* s) noexcept nogil:
    return unit(cross(sub(s.b, s.a), sub(s.c, s.a)))
