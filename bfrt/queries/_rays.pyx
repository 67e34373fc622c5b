"""Rays as a caller gives them, made into records."""

cimport cython
from libc.math cimport INFINITY, isfinite, isnan, ldexp, nextafter
from libc.stdint cimport int64_t, uint64_t

from bfrt.geometry.far cimport (
    Bounds, advance_far, before_bounds, bounds_of, fused_along, scale_extreme,
)
from bfrt.geometry.vector cimport Line, Vec, line, smaller, sub, vec
from bfrt.phases.nearest cimport ray_bad
from bfrt.records cimport NO_HIT, QueryRay, Ray


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
    """Return where a ray begins: at t_min, or where it comes to the scene, if that is long before.
    """
    cdef double t = before_bounds(l, b) if t_min < 0.0 else t_min
    return t if t > t_min and isfinite(t) else t_min


cdef inline bint set_ray(QueryRay* a, Vec o, Vec d, double t_min, double t_max,
                         const Bounds* b) noexcept nogil:
    """Set a record to a ray, scaled and brought near; false if it is bad, and hits nothing."""
    cdef int power = scale_extreme(&d)
    cdef Line l = line(o, d)
    cdef Ray r
    cdef bint good
    a.id, a.moved, a.power = NO_HIT, 0.0, power
    if t_min != 0.0:
        a.moved = begin_of(&l, b, ldexp(t_min, power))
        l.o = fused_along(l.o, a.moved, l.d)
    r.ox, r.oy, r.oz = l.o.x, l.o.y, l.o.z
    r.dx, r.dy, r.dz = l.d.x, l.d.y, l.d.z
    good = not (ray_bad(&r) or isnan(t_max))
    if good:
        a.moved += advance_far(&l, b)
        a.t = end_of(scaled_end(t_max, power), a.moved)
    else:
        l.d = vec(0.0, 0.0, 0.0)
        a.t = -1.0
    a.ox, a.oy, a.oz = l.o.x, l.o.y, l.o.z
    a.dx, a.dy, a.dz = l.d.x, l.d.y, l.d.z
    return good


@cython.final
cdef class RayRecords:
    """Makes the records of a query's rays, which are relative to the store's origin.

    Parameters
    ----------
    origin : sequence of 3 float
        The store's origin.
    bounds : (2, 3) float64
        The scene's, relative to it.
    kind : int
        The kind of the rays, a `bfrt.records.RayKind`.

    """

    cdef Vec origin
    cdef Bounds bounds
    cdef int kind

    def __cinit__(self, origin, const double[:, ::1] bounds, int kind):
        self.origin = vec(origin[0], origin[1], origin[2])
        self.bounds = bounds_of(bounds)
        self.kind = kind

    def fill(self, const double[:, ::1] origins, const double[:, ::1] directions,
             const double[::1] t_min, const double[::1] t_max, int64_t number, QueryRay[::1] out):
        """Make the records of rays, any thread some.

        Parameters
        ----------
        origins, directions : (n, 3) float64
            IN. World coordinates.
        t_min, t_max : (n,) float64
            IN. Hits count in (t_min, t_max): a ray begins at its t_min.
        number : int
            Of the first.
        out : (n,) records.QUERY_RAY
            OUT. Far origins are brought nearer (exactness rule 6); `moved` is the t of that.
            Extreme directions are divided by two to the `power`, by which their t are multiplied
            later.

        Returns
        -------
        int
            Rays that are NaN, infinite or of no length, and such that have a NaN for an end. They
            hit nothing.
        """
        cdef QueryRay* a
        cdef Vec o, d
        cdef int64_t i, bad = 0
        with nogil:
            for i in range(out.shape[0]):
                a = &out[i]
                a.number, a.kind, a.count = <uint64_t>(number + i), self.kind, 0
                o = sub(vec(origins[i, 0], origins[i, 1], origins[i, 2]), self.origin)
                d = vec(directions[i, 0], directions[i, 1], directions[i, 2])
                bad += not set_ray(a, o, d, t_min[i], t_max[i], &self.bounds)
        return bad
