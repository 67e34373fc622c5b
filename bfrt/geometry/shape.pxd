"""Any of the five kinds: the one switch over them, taken per object, never per ray."""

from libc.stdint cimport uint32_t

from bfrt.geometry.box cimport HIGH, Box, Span
from bfrt.geometry.cone cimport Cone, cone_bounds, cone_crossings, cone_hit, cone_load, cone_normal
from bfrt.geometry.coordinates cimport Frame
from bfrt.geometry.outline cimport Shear
from bfrt.geometry.packet cimport BoxPacket, eight_clear, eight_end
from bfrt.geometry.patch cimport Patch, patch_load, patch_normal
from bfrt.geometry.polygon cimport (
    Polygon, polygon_bounds, polygon_crossed, polygon_hit, polygon_load, polygon_missed,
)
from bfrt.geometry.sphere cimport (
    Sphere, sphere_bounds, sphere_crossings, sphere_hit, sphere_load, sphere_missed, sphere_normal,
)
from bfrt.geometry.triangle cimport (
    Barycentric, Triangle, triangle_bounds, triangle_crossed, triangle_cut, triangle_hit,
    triangle_load, triangle_missed, triangle_normal, triangle_place,
)
from bfrt.geometry.vector cimport Line, Vec, along
from bfrt.records cimport CONE, PATCH, POLYGON, SPHERE, TRIANGLE

cdef union AnyKind:
    Sphere sphere
    Cone cone
    Triangle triangle
    Patch patch
    Polygon polygon

cdef struct Shape:
    int kind
    AnyKind of

# What a hit shows: its place on the surface, the normal of that, the normal that shading uses,
# barycentric uv.
cdef struct Surface:
    Vec place
    Vec geometric
    Vec shading
    Barycentric uv

# A line that met an object's box, with its span there; `mark` is the caller's name for it, and
# t is the hit, or -1.
cdef struct BoxHit:
    Line line
    Span span
    double t
    uint32_t mark

ctypedef bint (*Hitter)(const void*, const Line*, const Span*, double*) noexcept nogil


cdef inline bint shape_load(int kind, const unsigned char* record, uint32_t count,
                            const Frame* f, Shape* s) noexcept nogil:
    """Read a record of `count` vertices (polygons only); false if it is degenerate."""
    s.kind = kind
    if kind == SPHERE:
        return sphere_load(record, f, &s.of.sphere)
    if kind == CONE:
        return cone_load(record, f, &s.of.cone)
    if kind == TRIANGLE:
        return triangle_load(record, f, &s.of.triangle)
    if kind == PATCH:
        return patch_load(record, f, &s.of.patch)
    return polygon_load(record, count, f, &s.of.polygon)


cdef inline bint shape_missed(int kind, const unsigned char* record, uint32_t count,
                              const Frame* f, const Line* l, const Shear* seen) noexcept nogil:
    """Tell of most records that a ray misses that it does, before more of them is worked out."""
    if kind == TRIANGLE or kind == PATCH:
        return triangle_missed(record, f, seen)
    if kind == SPHERE:
        return sphere_missed(record, f, l)
    if kind == POLYGON:
        return polygon_missed(record, count, f, seen)
    return False


cdef inline void shape_bounds(const Shape* s, Box* b) noexcept nogil:
    if s.kind == SPHERE:
        sphere_bounds(&s.of.sphere, b)
    elif s.kind == CONE:
        cone_bounds(&s.of.cone, b)
    elif s.kind == TRIANGLE:
        triangle_bounds(&s.of.triangle, b)
    elif s.kind == PATCH:
        triangle_bounds(&s.of.patch.face, b)
    else:
        polygon_bounds(&s.of.polygon, b)


cdef inline void shape_boxes(int kind, const unsigned char* records, size_t stride, const Frame* f,
                             int n, BoxPacket* e) noexcept nogil:
    """Compute the boxes of n records of one size, BOXES or fewer; empty ones of degenerate objects.
    """
    cdef Shape s
    cdef Box b
    cdef int i, k
    for i in range(n):
        if not shape_load(kind, records + i * stride, 0, f, &s):
            eight_clear(e, i)
            continue
        shape_bounds(&s, &b)
        for k in range(3):
            e.side[k][i], e.side[HIGH + k][i] = b.lo[k], b.hi[k]
    eight_end(e, n)


cdef inline void meet(Hitter hit, const void* shape, BoxHit* meetings, int n) noexcept nogil:
    """Run one kernel over many meetings; the compiler makes one loop for each kernel."""
    cdef int i
    for i in range(n):
        if not hit(shape, &meetings[i].line, &meetings[i].span, &meetings[i].t):
            meetings[i].t = -1.0


cdef inline void shape_meet(const Shape* s, BoxHit* meetings, int n) noexcept nogil:
    """Find the hit of each meeting: the nearest in its span, or -1."""
    if s.kind == SPHERE:
        meet(<Hitter>sphere_hit, &s.of.sphere, meetings, n)
    elif s.kind == CONE:
        meet(<Hitter>cone_hit, &s.of.cone, meetings, n)
    elif s.kind == TRIANGLE:
        meet(<Hitter>triangle_hit, &s.of.triangle, meetings, n)
    elif s.kind == PATCH:
        meet(<Hitter>triangle_hit, &s.of.patch.face, meetings, n)
    else:
        meet(<Hitter>polygon_hit, &s.of.polygon, meetings, n)


cdef inline int shape_crossings(const Shape* s, const Line* l, const Span* span,
                                double* t) noexcept nogil:
    """Find all crossings in the span, ascending; return how many.

    A sphere or a cone has two at the most, and one where it is touched. Of faces that share an edge
    or a corner just one has a crossing there.
    """
    if s.kind == SPHERE:
        return sphere_crossings(&s.of.sphere, l, span, t)
    if s.kind == CONE:
        return cone_crossings(&s.of.cone, l, span, t)
    if s.kind == TRIANGLE:
        return triangle_crossed(&s.of.triangle, l, span, t)
    if s.kind == PATCH:
        return triangle_crossed(&s.of.patch.face, l, span, t)
    return polygon_crossed(&s.of.polygon, l, span, t)


cdef inline void face_surface(const Triangle* s, const Line* l, Surface* out) noexcept nogil:
    """Take place, normal and weights from a triangle.

    The place is that of the weights, for o + t d leaves a sliver by the rounding of t.
    """
    cdef double again
    triangle_cut(s, l, &again, &out.uv)
    out.place = triangle_place(s, &out.uv)
    out.geometric = triangle_normal(s)


cdef inline void shape_surface(const Shape* s, const Line* l, double t,
                               Surface* out) noexcept nogil:
    """Compute the surface where the line hits at t: place, normals, uv."""
    out.place = along(l.o, l.d, t)
    out.uv.u = out.uv.v = 0.0
    if s.kind == SPHERE:
        out.geometric = sphere_normal(&s.of.sphere, out.place)
    elif s.kind == CONE:
        out.geometric = cone_normal(&s.of.cone, out.place)
    elif s.kind == TRIANGLE:
        face_surface(&s.of.triangle, l, out)
    elif s.kind == PATCH:
        face_surface(&s.of.patch.face, l, out)
    else:
        out.geometric = s.of.polygon.normal
    out.shading = out.geometric
    if s.kind == PATCH:
        out.shading = patch_normal(&s.of.patch, &out.uv)
