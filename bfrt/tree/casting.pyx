"""Rays through a resident forest, from records to rows of an answer, with nothing between."""

cimport cython
from libc.math cimport INFINITY, ldexp
from libc.stdint cimport int32_t, int64_t, uint8_t, uint32_t, uint64_t

from bfrt.geometry.box cimport Box
from bfrt.geometry.departure cimport hit_error, next_origin, world_error
from bfrt.geometry.shape cimport Shape, Surface, shape_bounds, shape_load, shape_surface
from bfrt.geometry.vector cimport Line, Vec, add, line, unit, vec
from bfrt.records cimport INDEX_BITS, NO_HIT, QueryRay
from bfrt.scan.given_order cimport GivenOrder
from bfrt.tree.descent cimport (
    ABREAST, Descent, Source, TakeRay, count_tests, descend_all,
)
from bfrt.tree.forest cimport Forest, TreeStream, stream_numbered
from bfrt.tree.walk cimport Search, aim


# Rays of a question, and the rows of the answer that they fill: of hits, or whether there are any.
cdef struct Casting:
    void* forest    # a Forest
    const QueryRay* rays
    int64_t count
    int64_t next
    uint8_t* hit
    double* t
    int32_t* geometry
    int64_t* primitive
    float* normal
    float* uv
    double* position  # NULL where it is not asked for
    double* departure
    int side          # of departures


cdef bint next_query(void* source, Descent* d) noexcept nogil:
    """Set up the next ray's search."""
    cdef Casting* c = <Casting*>source
    cdef Search* s = &d.search
    cdef const QueryRay* q
    cdef Line l
    if c.next == c.count:
        return False
    q = c.rays + c.next
    d.row = c.next
    c.next += 1
    l = line(vec(q.ox, q.oy, q.oz), vec(q.dx, q.dy, q.dz))
    aim(s, &l, (<Forest>c.forest).padding)
    s.id, s.kind, s.t = NO_HIT, <uint8_t>q.kind, q.t
    return True


cdef void take_hit(void* source, const Descent* d) noexcept nogil:
    (<Casting*>source).hit[d.row] = d.search.id != NO_HIT


cdef inline void put_place(double* places, int64_t row, Vec p) noexcept nogil:
    """Fill a row of places, where these are asked for."""
    if places != NULL:
        places[3 * row], places[3 * row + 1], places[3 * row + 2] = p.x, p.y, p.z


cdef void take_row(void* source, const Descent* d) noexcept nogil:
    """Fill a row of an answer."""
    cdef Casting* c = <Casting*>source
    cdef const Search* s = &d.search
    cdef const QueryRay* q = c.rays + d.row
    cdef float* normal = c.normal + 3 * d.row
    cdef float* uv = c.uv + 2 * d.row
    cdef Surface found
    if s.id == NO_HIT:
        c.t[d.row], c.geometry[d.row], c.primitive[d.row] = INFINITY, -1, -1
        normal[0] = normal[1] = normal[2] = uv[0] = uv[1] = 0.0
        put_place(c.position, d.row, vec(INFINITY, INFINITY, INFINITY))
        put_place(c.departure, d.row, vec(INFINITY, INFINITY, INFINITY))
        return
    c.t[d.row] = ldexp(s.t + q.moved, -q.power)
    c.geometry[d.row] = <int32_t>(s.id >> INDEX_BITS)
    c.primitive[d.row] = surface_at(c, d, &found)
    normal[0], normal[1] = <float>found.geometric.x, <float>found.geometric.y
    normal[2] = <float>found.geometric.z
    uv[0], uv[1] = <float>found.uv.u, <float>found.uv.v


cdef int64_t surface_at(Casting* c, const Descent* d, Surface* found) noexcept nogil:
    """Find the surface at a search's hit, and fill in where that is, if it is asked for; return the
    place that the object was given at."""
    cdef const Search* s = &d.search
    cdef const TreeStream* stream = stream_numbered(<Forest>c.forest, s.id >> INDEX_BITS)
    cdef uint64_t record = s.id & ((<uint64_t>1 << INDEX_BITS) - 1)
    cdef uint64_t place = record
    cdef uint32_t count = 0
    cdef Shape shape
    cdef Box box
    cdef Vec p
    if stream.counted:
        record = stream.ends[place - 1] if place else 0
        count = <uint32_t>(stream.ends[place] - record)
    shape_load(
        stream.kind, stream.records + record * stream.stride, count, &stream.frame, &shape
    )
    shape_surface(&shape, &s.line, s.t, found)
    p = add(found.place, stream.frame.origin)
    put_place(c.position, d.row, p)
    if c.departure != NULL:
        shape_bounds(&shape, &box)
        p = next_origin(
            found, p, unit(s.line.d), hit_error(&s.line, s.t, found.place, &box) + world_error(p),
            c.side,
        )
        put_place(c.departure, d.row, p)
    if stream.id_bytes == 4:
        return (<const uint32_t*>stream.ids)[place]
    return (<const int64_t*>stream.ids)[place]


@cython.final
cdef class TreeCaster:
    """Runs one worker's loops over rays that somebody asks about.

    Parameters
    ----------
    forest : Forest
        A resident one.
    order : GivenOrder
    """

    cdef Forest forest
    cdef GivenOrder order
    cdef Descent abreast[ABREAST]
    cdef Casting casting

    def __cinit__(self, Forest forest not None, GivenOrder order not None):
        cdef Search* s
        cdef int k
        self.forest, self.order = forest, order
        self.casting.forest = <void*>forest
        for k in range(ABREAST):
            s = &self.abreast[k].search
            s.order, s.spans, s.crossings = <void*>order, forest.top.spans, NULL
            s.node_tests = s.object_tests = 0
            s.polygon_id = NO_HIT

    def occluded(self, const QueryRay[::1] rays, uint8_t[::1] hit):
        """Tell of rays, (n,) of records.QUERY_RAY, whether they hit anything: (n,) of 0 and 1."""
        if rays.shape[0]:
            self.casting.hit = &hit[0]
            self.go(rays, take_hit)

    def nearest(self, const QueryRay[::1] rays, dict columns, int side):
        """Find the nearest hits of rays.

        Parameters
        ----------
        rays : (n,) records.QUERY_RAY
            IN.
        columns : dict of arrays
            OUT. Those of `bfrt.cast_rays`, n rows each.
        side : int
            Of ``next_origins``: a side of ``departure.pxd``.
        """
        cdef double[::1] t = columns["t_hit"]
        cdef int32_t[::1] geometry = columns["geometry_ids"]
        cdef int64_t[::1] primitive = columns["primitive_ids"]
        cdef float[:, ::1] normals = columns["primitive_normals"]
        cdef float[:, ::1] uvs = columns["primitive_uvs"]
        cdef double[:, ::1] positions = columns.get("positions")
        cdef double[:, ::1] departures = columns.get("next_origins")
        if rays.shape[0]:
            self.casting.t, self.casting.geometry = &t[0], &geometry[0]
            self.casting.primitive = &primitive[0]
            self.casting.normal, self.casting.uv = &normals[0, 0], &uvs[0, 0]
            self.casting.position = NULL if positions is None else &positions[0, 0]
            self.casting.departure = NULL if departures is None else &departures[0, 0]
            self.casting.side = side
            self.go(rays, take_row)

    cdef int go(self, const QueryRay[::1] rays, TakeRay take) except -1:
        """Take rays down, each to its row."""
        cdef Source source
        self.casting.rays, self.casting.count, self.casting.next = &rays[0], rays.shape[0], 0
        source.source, source.next, source.take = &self.casting, next_query, take
        with nogil:
            descend_all(self.forest, self.abreast, &source)
        return 0

    def tests(self):
        """Return the nodes and the objects tested since the last call."""
        return count_tests(self.abreast)
