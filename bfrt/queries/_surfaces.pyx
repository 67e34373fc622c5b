"""The surfaces that rays hit: what is read of an object once it is known to be the nearest."""

from libc.stdint cimport int64_t, uint64_t

from bfrt.geometry.shape cimport Shape, Surface, shape_load, shape_surface
from bfrt.geometry.vector cimport Line, line, vec
from bfrt.records cimport INDEX_BITS, NO_HIT, QueryRay
from bfrt.scan.column cimport pick_number
from bfrt.scan.geometry cimport GeometryCursor, pick_record
from bfrt.scan.scan cimport StreamScan


def surfaces(StreamScan scan, const QueryRay[::1] hits, uint64_t[::1] ids, float[:, ::1] normals,
             float[:, ::1] uvs):
    """Find the surfaces at hits on the objects that the scan picks: only those are read.

    Parameters
    ----------
    hits : (n,) records.QUERY_RAY
        IN. Ascending by id.
    ids : (n,) uint64
        OUT. Their objects' ids, by the order given.
    normals, uvs : (n, 3), (n, 2) float32
        OUT. Unit geometric normals; barycentric u and v of triangles and patches, else 0.
    """
    cdef GeometryCursor g = scan.geometry
    cdef int64_t i
    cdef uint64_t id = NO_HIT, given = NO_HIT
    cdef const QueryRay* h
    cdef const unsigned char* record
    cdef Shape shape
    cdef Surface s
    cdef Line l
    with nogil:
        for i in range(hits.shape[0]):
            h = &hits[i]
            if h.id != id:
                id = h.id
                record = pick_record(g)
                given = pick_number(scan.ids) | <uint64_t>scan.number << INDEX_BITS
                shape_load(g.kind, record, g.count, &g.frame, &shape)
            ids[i] = given
            l = line(vec(h.ox, h.oy, h.oz), vec(h.dx, h.dy, h.dz))
            shape_surface(&shape, &l, h.t, &s)
            normals[i, 0], normals[i, 1] = <float>s.geometric.x, <float>s.geometric.y
            normals[i, 2] = <float>s.geometric.z
            uvs[i, 0], uvs[i, 1] = <float>s.uv.u, <float>s.uv.v
