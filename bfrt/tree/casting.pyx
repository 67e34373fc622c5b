"""Rays through a resident forest, from records to rows of an answer, with nothing between."""

cimport cython
from libc.math cimport INFINITY, ldexp
from libc.stdint cimport int32_t, int64_t, uint8_t, uint32_t, uint64_t

from bfrt.geometry.shape cimport Shape, Surface, shape_load, shape_surface
from bfrt.geometry.vector cimport Line, line, vec
from bfrt.records cimport INDEX_BITS, NO_HIT, QueryRay
from bfrt.scan.given_order cimport GivenOrder
from bfrt.tree.descent cimport descend
from bfrt.tree.forest cimport Forest, TreeStream
from bfrt.tree.walk cimport Search, aim, set_reach


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
    cdef Search search

    def __cinit__(self, Forest forest not None, GivenOrder order not None):
        self.forest, self.order = forest, order
        self.search.order = <void*>order
        self.search.spans = forest.top.spans
        self.search.crossings = NULL

    cdef int find(self, const QueryRay* q) except -1 nogil:
        """Find the nearest hit of a ray, or any."""
        cdef Search* s = &self.search
        cdef Line l
        s.id = NO_HIT
        if q.t < 0.0:  # it is bad
            return 0
        l = line(vec(q.ox, q.oy, q.oz), vec(q.dx, q.dy, q.dz))
        aim(s, &l, self.forest.padding)
        s.kind = <uint8_t>q.kind
        set_reach(s, q.t)
        return descend(self.forest, s)

    def occluded(self, const QueryRay[::1] rays, uint8_t[::1] hit):
        """Tell of rays, (n,) of records.QUERY_RAY, whether they hit anything: (n,) of 0 and 1."""
        cdef int64_t i
        with nogil:
            for i in range(rays.shape[0]):
                self.find(&rays[i])
                hit[i] = self.search.id != NO_HIT

    def nearest(self, const QueryRay[::1] rays, dict columns):
        """Find the nearest hits of rays.

        Parameters
        ----------
        rays : (n,) records.QUERY_RAY
            IN.
        columns : dict of arrays
            OUT. Those of `bfrt.cast_rays`, n rows each.
        """
        cdef double[::1] t = columns["t_hit"]
        cdef int32_t[::1] geometry = columns["geometry_ids"]
        cdef int64_t[::1] primitive = columns["primitive_ids"]
        cdef float[:, ::1] normals = columns["primitive_normals"]
        cdef float[:, ::1] uvs = columns["primitive_uvs"]
        cdef Search* s = &self.search
        cdef const QueryRay* q
        cdef Surface found
        cdef int64_t i, k
        with nogil:
            for i in range(rays.shape[0]):
                q = &rays[i]
                self.find(q)
                if s.id == NO_HIT:
                    t[i], geometry[i], primitive[i] = INFINITY, -1, -1
                    for k in range(3):
                        normals[i, k] = 0.0
                    uvs[i, 0] = uvs[i, 1] = 0.0
                    continue
                t[i] = ldexp(s.t + q.moved, -q.power)
                geometry[i] = <int32_t>(s.id >> INDEX_BITS)
                primitive[i] = self.surface(&found)
                normals[i, 0], normals[i, 1] = <float>found.geometric.x, <float>found.geometric.y
                normals[i, 2] = <float>found.geometric.z
                uvs[i, 0], uvs[i, 1] = <float>found.uv.u, <float>found.uv.v

    cdef int64_t surface(self, Surface* found) noexcept nogil:
        """Find the surface at the search's hit; return the place that the object was given at."""
        cdef Search* s = &self.search
        cdef const TreeStream* stream = self.stream_of(s.id >> INDEX_BITS)
        cdef uint64_t place = s.id & ((<uint64_t>1 << INDEX_BITS) - 1)
        cdef uint64_t record = place
        cdef uint32_t count = 0
        cdef Shape shape
        if stream.counted:
            record = stream.ends[place - 1] if place else 0
            count = <uint32_t>(stream.ends[place] - record)
        shape_load(
            stream.kind, stream.records + record * stream.stride, count, &stream.frame, &shape
        )
        shape_surface(&shape, &s.line, s.t, found)
        if stream.id_bytes == 4:
            return (<const uint32_t*>stream.ids)[place]
        return (<const int64_t*>stream.ids)[place]

    cdef const TreeStream* stream_of(self, uint64_t number) noexcept nogil:
        """Return a stream by its number."""
        cdef const TreeStream* s = self.forest.streams
        while s.number != number:
            s += 1
        return s

    def tests(self):
        """Return the nodes and the objects tested since the last call."""
        cdef int64_t nodes = self.search.node_tests, objects = self.search.object_tests
        self.search.node_tests = self.search.object_tests = 0
        return nodes, objects
