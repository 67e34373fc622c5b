"""Polygon: any number of vertices, concave or convex, in one plane as nearly as floats allow."""

from libc.math cimport INFINITY, fabs
from libc.stdint cimport uint32_t

from bfrt.geometry.box cimport Box, Span, box_between
from bfrt.geometry.coordinates cimport Frame, point
from bfrt.geometry.outline cimport (
    Shear, edge_crossed, edge_met, edge_side, shear_along, sheared, steepest,
)
from bfrt.geometry.vector cimport (
    Line, Vec, add, cross, dot, highest, larger, largest, lowest, scale, smaller, sub, unit, vec,
)

cdef extern from *:
    """
    /* Of a sum of three products, with room: units in the last place of its terms. */
    #define BFRT_ROUNDING 0x1p-48
    """
    const double ROUNDING "BFRT_ROUNDING"

cdef struct Polygon:
    const unsigned char* vertices
    uint32_t count
    Frame frame
    Vec center   # mean of the vertices: the plane goes through it
    Vec normal   # Newell's, unit
    double thickness  # the most that a vertex is off the plane, rounding included

# Whether a polygon owns a hit, as one of all faces at an edge or a corner does; whether the line
# meets an edge of it.
cdef struct Contact:
    bint owned
    bint on_edge


cdef inline Vec corner(const Polygon* s, uint32_t i) noexcept nogil:
    """Return vertex i."""
    return point(s.vertices, 3 * i, &s.frame)


cdef inline Vec vertex(const Polygon* s, uint32_t i) noexcept nogil:
    """Return vertex i as seen from the center."""
    return sub(corner(s, i), s.center)


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
    s.thickness = 0.0
    for i in range(count):
        a = vertex(s, i)
        s.thickness = larger(fabs(dot(a, s.normal)) + ROUNDING * largest(a), s.thickness)
    return True


cdef inline void polygon_bounds(const Polygon* s, Box* b) noexcept nogil:
    """Compute the box of the vertices and of their places on the plane, along its steepest axis.

    A polygon is rarely quite flat, and a hit is on its plane: both together contain the hits of
    one that is nearly so, and a hit of any other is brought into the box.
    """
    cdef Vec lo = vec(INFINITY, INFINITY, INFINITY), hi = scale(lo, -1.0)
    cdef Vec v, flat
    cdef uint32_t i
    cdef int drop = steepest(s.normal)
    cdef double off
    for i in range(s.count):
        v = vertex(s, i)
        off = dot(v, s.normal)
        flat = v
        if drop == 0:
            flat.x -= off / s.normal.x
        elif drop == 1:
            flat.y -= off / s.normal.y
        else:
            flat.z -= off / s.normal.z
        v, flat = add(v, s.center), add(flat, s.center)
        lo, hi = lowest(lowest(lo, v), flat), highest(highest(hi, v), flat)
    box_between(b, lo, hi)


cdef inline bint polygon_plane(const Polygon* s, const Line* l, const Span* span,
                               double* t) noexcept nogil:
    """Find where the line meets the plane, brought into the span; false if far out of it.

    A line that passes inside the outline does so in the span, for that is where it is in the box.
    Its t may be elsewhere by as much as the polygon is off its plane, and what was rounded, over
    the slope: those are let through, and the outline decides.
    """
    cdef double slope = dot(s.normal, l.d)
    cdef Vec o = sub(l.o, s.center)
    cdef double slack = (s.thickness + ROUNDING * largest(o)) / fabs(slope)
    t[0] = -dot(s.normal, o) / slope
    if t[0] + slack < span.near or t[0] - slack > span.far:
        return False
    t[0] = smaller(larger(t[0], span.near), span.far)
    return t[0] > 0.0


cdef inline Contact outline_contact(const unsigned char* vertices, uint32_t count, const Frame* f,
                                    const Shear* seen) noexcept nogil:
    """Find whether the line meets an edge, and whether the polygon owns it (outline.pxd).

    Few edges reach the x axis: of all others only y is worked out.
    """
    cdef Contact c
    cdef Vec a, b
    cdef double side
    cdef uint32_t i, before = count - 1
    cdef double y, last = sheared(seen, point(vertices, 3 * before, f)).y
    c.owned = c.on_edge = False
    for i in range(count):
        y = sheared(seen, point(vertices, 3 * i, f)).y
        if larger(last, y) >= 0.0 >= smaller(last, y):
            a = sheared(seen, point(vertices, 3 * before, f))
            b = sheared(seen, point(vertices, 3 * i, f))
            side = edge_side(a, b)
            c.owned ^= edge_crossed(a, b, side)
            c.on_edge |= edge_met(a, b, side)
        last, before = y, i
    return c


cdef inline bint polygon_missed(const unsigned char* record, uint32_t count, const Frame* f,
                                const Shear* seen) noexcept nogil:
    """Tell whether a line misses a record's outline, as `polygon_hit` does."""
    cdef Contact c
    if count < 3:
        return True
    c = outline_contact(record, count, f, seen)
    return not (c.owned or c.on_edge)


cdef inline Contact polygon_contact(const Polygon* s, const Line* l) noexcept nogil:
    cdef Shear seen = shear_along(l)
    return outline_contact(s.vertices, s.count, &s.frame, &seen)


cdef inline bint polygon_hit(const Polygon* s, const Line* l, const Span* span,
                             double* t) noexcept nogil:
    """Tell whether the line meets the polygon, edges and corners included, beyond its origin.

    Seen edge on, the outline is all edge: then it is a miss.
    """
    cdef Contact c
    if not polygon_plane(s, l, span, t):
        return False
    c = polygon_contact(s, l)
    return c.owned or (c.on_edge and dot(s.normal, l.d) != 0.0)


cdef inline bint polygon_crossed(const Polygon* s, const Line* l, const Span* span,
                                 double* t) noexcept nogil:
    """Tell whether the polygon owns the hit: at a shared edge or corner just one face does."""
    return polygon_plane(s, l, span, t) and polygon_contact(s, l).owned
