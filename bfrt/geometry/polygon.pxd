"""Polygon: any number of vertices, concave or convex, in one plane as nearly as floats allow."""

from libc.math cimport INFINITY
from libc.stdint cimport uint32_t

from bfrt.geometry.box cimport Box, Span, box_between
from bfrt.geometry.coordinates cimport Frame, point
from bfrt.geometry.triangle cimport permuted, steepest
from bfrt.geometry.vector cimport (
    Line, Vec, add, along, cross, dot, highest, lowest, scale, sub, unit, vec,
)

cdef struct Polygon:
    const unsigned char* vertices
    uint32_t count
    Frame frame
    Vec center   # mean of the vertices: the plane goes through it
    Vec normal   # Newell's, unit
    int drop     # the axis along which the outline is looked at


cdef inline Vec vertex(const Polygon* s, uint32_t i) noexcept nogil:
    """Vertex i as seen from the center."""
    return sub(point(s.vertices, 3 * i, &s.frame), s.center)


cdef inline bint polygon_load(const unsigned char* record, uint32_t count, const Frame* f,
                              Polygon* s) noexcept nogil:
    """Take a record of `count` vertices, which must stay where it is; false if degenerate."""
    cdef Vec n = vec(0.0, 0.0, 0.0)
    cdef Vec a, b
    cdef uint32_t i
    if count < 3:
        return False
    s.vertices = record
    s.count = count
    s.frame = f[0]
    s.center = vec(0.0, 0.0, 0.0)
    for i in range(count):
        n = add(n, point(record, 3 * i, f))
    s.center = scale(n, 1.0 / count)
    n = vec(0.0, 0.0, 0.0)
    a = vertex(s, count - 1)
    for i in range(count):  # Newell's sum of cross products is twice the area
        b = vertex(s, i)
        n = add(n, cross(a, b))
        a = b
    if not dot(n, n) > 0.0:
        return False
    s.normal = unit(n)
    s.drop = steepest(s.normal)
    return True


cdef inline void polygon_bounds(const Polygon* s, Box* b) noexcept nogil:
    """The vertices, and where each meets the plane along the dropped axis.

    A polygon is rarely quite flat. A hit is on its plane and inside its outline as seen along
    that axis, so both together contain every hit.
    """
    cdef Vec lo = vec(INFINITY, INFINITY, INFINITY), hi = scale(lo, -1.0)
    cdef Vec v, flat
    cdef uint32_t i
    cdef double off
    for i in range(s.count):
        v = vertex(s, i)
        off = dot(v, s.normal)
        flat = v
        if s.drop == 0:
            flat.x -= off / s.normal.x
        elif s.drop == 1:
            flat.y -= off / s.normal.y
        else:
            flat.z -= off / s.normal.z
        v, flat = add(v, s.center), add(flat, s.center)
        lo, hi = lowest(lowest(lo, v), flat), highest(highest(hi, v), flat)
    box_between(b, lo, hi)


cdef inline bint polygon_contains(const Polygon* s, Vec p) noexcept nogil:
    """Crossing number of the outline around p, seen along the dropped axis.

    An edge counts where exactly one end is above p, so that a vertex counts once, and neighbours
    that share an edge never both claim a point on it, nor both leave it: the edge decides, not the
    way it is walked. (Of a ray that aims at the edge each finds a p of its own, though, rounding
    included: only triangles are watertight.)
    """
    cdef bint inside = False
    cdef Vec a = permuted(sub(vertex(s, s.count - 1), p), s.drop)
    cdef Vec b
    cdef double side
    cdef uint32_t i
    for i in range(s.count):
        b = permuted(sub(vertex(s, i), p), s.drop)
        if (a.y > 0.0) != (b.y > 0.0):
            side = a.x * b.y - a.y * b.x
            if side > 0.0 if b.y > a.y else side < 0.0:
                inside = not inside
        a = b
    return inside


cdef inline bint polygon_hit(const Polygon* s, const Line* l, const Span* span,
                             double* t) noexcept nogil:
    cdef double slope = dot(s.normal, l.d)
    cdef Vec o
    if slope == 0.0:
        return False
    o = sub(l.o, s.center)
    t[0] = -dot(s.normal, o) / slope
    if not (t[0] > 0.0 and span.near <= t[0] <= span.far):
        return False
    return polygon_contains(s, along(o, l.d, t[0]))
