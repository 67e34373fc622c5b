"""The surfaces that rays hit: what is read of an object once it is known to be the nearest."""

from libc.stdint cimport int64_t, uint64_t

from bfrt.geometry.box cimport Box, box_clear
from bfrt.geometry.departure cimport hit_error, next_origin, world_error
from bfrt.geometry.shape cimport Shape, Surface, shape_bounds, shape_load, shape_surface
from bfrt.geometry.vector cimport Line, Vec, add, line, unit, vec
from bfrt.records cimport INDEX_BITS, NO_HIT, QueryRay
from bfrt.scan.column cimport pick_number
from bfrt.scan.geometry cimport GeometryCursor, pick_record
from bfrt.scan.scan cimport StreamScan


def surfaces(StreamScan scan, const QueryRay[::1] hits, uint64_t[::1] ids, dict columns, int side):
    """Find the surfaces at hits on the objects that the scan picks: only those are read.

    Parameters
    ----------
    hits : (n,) records.QUERY_RAY
        IN. Ascending by id.
    ids : (n,) uint64
        OUT. Their objects' ids, by the order given.
    columns : dict of arrays
        OUT. ``primitive_normals`` (n, 3) float32: unit geometric normals. ``primitive_uvs`` (n, 2)
        float32: barycentric u and v of triangles and patches, else 0. Where they are there,
        ``positions`` and ``next_origins`` (n, 3) float64: where the hits are, world coordinates,
        and the same off the surface.
    side : int
        Of ``next_origins``: a side of ``departure.pxd``.
    """
    cdef GeometryCursor g = scan.geometry
    cdef float[:, ::1] normals = columns["primitive_normals"]
    cdef float[:, ::1] uvs = columns["primitive_uvs"]
    cdef double[:, ::1] positions = columns.get("positions")
    cdef double[:, ::1] nexts = columns.get("next_origins")
    cdef bint placed = positions is not None, departed = nexts is not None
    cdef int64_t i
    cdef uint64_t id = NO_HIT, given = NO_HIT
    cdef const QueryRay* h
    cdef const unsigned char* record
    cdef Shape shape
    cdef Box box
    cdef Surface s
    cdef Line l
    cdef Vec p
    box_clear(&box)
    with nogil:
        for i in range(hits.shape[0]):
            h = &hits[i]
            if h.id != id:
                id = h.id
                record = pick_record(g)
                given = pick_number(scan.ids) | <uint64_t>scan.number << INDEX_BITS
                shape_load(g.kind, record, g.count, &g.frame, &shape)
                if departed:
                    shape_bounds(&shape, &box)
            ids[i] = given
            l = line(vec(h.ox, h.oy, h.oz), vec(h.dx, h.dy, h.dz))
            shape_surface(&shape, &l, h.t, &s)
            normals[i, 0], normals[i, 1] = <float>s.geometric.x, <float>s.geometric.y
            normals[i, 2] = <float>s.geometric.z
            uvs[i, 0], uvs[i, 1] = <float>s.uv.u, <float>s.uv.v
            p = add(s.place, g.frame.origin)
            if placed:
                positions[i, 0], positions[i, 1], positions[i, 2] = p.x, p.y, p.z
            if departed:
                p = next_origin(
                    &s, p, unit(l.d), hit_error(&l, h.t, s.place, &box) + world_error(p), side
                )
                nexts[i, 0], nexts[i, 1], nexts[i, 2] = p.x, p.y, p.z
