"""The loops of queries: rays as a caller gives them, and the surfaces that they hit."""

from libc.math cimport INFINITY, isfinite, isnan, ldexp, nextafter
from libc.stdint cimport int64_t, uint64_t

from bfrt.geometry.far cimport (
    Bounds, advance_far, before_bounds, bounds_of, fused_along, scale_extreme,
)
from bfrt.geometry.shape cimport Shape, Surface, shape_load, shape_surface
from bfrt.geometry.vector cimport Line, Vec, line, smaller, vec
from bfrt.phases.nearest cimport ray_bad
from bfrt.records cimport NO_HIT, QueryRay, Ray
from bfrt.scan.geometry cimport GeometryCursor, pick_record
from bfrt.scan.scan cimport StreamScan


cdef inline double end_of(double t_max, double moved) noexcept nogil:
    """Return the end of a moved ray: the greatest t, or nearly, for which t + `moved` < t_max."""
    cdef double t = t_max - moved
    if not isfinite(t):
        return t
    if t + moved >= t_max:
        t = nextafter(t_max, -INFINITY) - moved
    while t + moved >= t_max:  # which rounding may have brought up again
        t = nextafter(t, -INFINITY)
    return t


cdef enum:
    BEYOND = 1024  # two to this is no double


cdef inline double scaled_end(double t_max, int power) noexcept nogil:
    """Return t_max in lengths of a direction that was divided by a power of two. A t that the
    original lengths cannot express is beyond the end.
    """
    cdef double t = ldexp(t_max, power)
    return smaller(t, ldexp(1.0, BEYOND + power)) if power < 0 else t


cdef inline double begin_of(const Line* l, const Bounds* b, double t_min) noexcept nogil:
    """Where a ray begins: at t_min, or where it comes to the scene, if that is long before."""
    cdef double t = before_bounds(l, b) if t_min < 0.0 else t_min
    return t if t > t_min and isfinite(t) else t_min


def ask(const double[:, ::1] origins, const double[:, ::1] directions, const double[::1] t_min,
        const double[::1] t_max, origin, const double[:, ::1] bounds, uint64_t first, int kind,
        QueryRay[::1] out):
    """Make the records of rays.

    Parameters
    ----------
    origins, directions : (n, 3) float64
        IN. World coordinates.
    t_min, t_max : (n,) float64
        IN. Hits count in (t_min, t_max): a ray begins at its t_min.
    origin : sequence of 3 float
        The store's origin.
    bounds : (2, 3) float64
        IN. The scene's, relative to the store's origin.
    first : int
        The first ray's number; the others' follow.
    kind : int
        The kind of the rays, a `bfrt.records.RayKind`.
    out : (n,) records.QUERY_RAY
        OUT. Far origins are brought nearer (exactness rule 6); `moved` is the t of that. Extreme
        directions are divided by two to the `power`, by which their t are multiplied later.

    Returns
    -------
    bad : int
        Rays that are NaN, infinite or of no length, and such that have a NaN for an end. They hit
        nothing.
    """
    cdef Bounds b = bounds_of(bounds)
    cdef Line l
    cdef Vec d
    cdef Ray r
    cdef QueryRay* a
    cdef double x = origin[0], y = origin[1], z = origin[2]
    cdef int64_t i, bad = 0
    cdef int power
    with nogil:
        for i in range(out.shape[0]):
            a = &out[i]
            a.number, a.kind, a.count = first + <uint64_t>i, kind, 0
            a.id, a.moved = NO_HIT, 0.0
            d = vec(directions[i, 0], directions[i, 1], directions[i, 2])
            power = scale_extreme(&d)
            a.power = power
            l = line(vec(origins[i, 0] - x, origins[i, 1] - y, origins[i, 2] - z), d)
            if t_min[i] != 0.0:
                a.moved = begin_of(&l, &b, ldexp(t_min[i], power))
                l.o = fused_along(l.o, a.moved, l.d)
            r.ox, r.oy, r.oz = l.o.x, l.o.y, l.o.z
            r.dx, r.dy, r.dz = l.d.x, l.d.y, l.d.z
            if ray_bad(&r) or isnan(t_max[i]):
                bad += 1
                l.d = vec(0.0, 0.0, 0.0)
                a.t = -1.0
            else:
                a.moved += advance_far(&l, &b)
                a.t = end_of(scaled_end(t_max[i], power), a.moved)
            a.ox, a.oy, a.oz = l.o.x, l.o.y, l.o.z
            a.dx, a.dy, a.dz = l.d.x, l.d.y, l.d.z
    return bad


def surfaces(StreamScan scan, const QueryRay[::1] hits, float[:, ::1] normals, float[:, ::1] uvs):
    """Find the surfaces at hits on the objects that the scan picks: only those are read.

    Parameters
    ----------
    hits : (n,) records.QUERY_RAY
        IN. Ascending by id.
    normals, uvs : (n, 3), (n, 2) float32
        OUT. Unit geometric normals; barycentric u and v of triangles and patches, else 0.
    """
    cdef GeometryCursor g = scan.geometry
    cdef int64_t i
    cdef uint64_t id = NO_HIT
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
                shape_load(g.kind, record, g.count, &g.frame, &shape)
            l = line(vec(h.ox, h.oy, h.oz), vec(h.dx, h.dy, h.dz))
            shape_surface(&shape, &l, h.t, &s)
            normals[i, 0], normals[i, 1] = <float>s.geometric.x, <float>s.geometric.y
            normals[i, 2] = <float>s.geometric.z
            uvs[i, 0], uvs[i, 1] = <float>s.uv.u, <float>s.uv.v
