"""Rays from points to all sides, or to those above a surface."""

cimport cython
from libc.math cimport sqrt
from libc.stdint cimport int64_t, uint64_t

from bfrt.geometry.departure cimport place_error, world_error
from bfrt.geometry.far cimport Bounds, bounds_of, scale_extreme
from bfrt.geometry.vector cimport Vec, add, along, scale, sub, unit, vec
from bfrt.phases.hashing cimport mixed, uniform

import numpy as np

cpdef enum Spread:
    AROUND   # all directions alike
    UNIFORM  # those of a hemisphere alike
    COSINE   # as many as light from there counts on a surface

# The golden angle, by which the azimuths of a spiral's points go on.
cdef double GOLDEN_COSINE = -0.7373688780783197
cdef double GOLDEN_SINE = 0.6754902942615238

# A point of the unit circle, or a rotation to there.
cdef struct Turn:
    double c
    double s

# Unit vectors at right angles, of which z is the normal.
cdef struct Axes:
    Vec x
    Vec y
    Vec z


cdef inline Turn turned(Turn a, Turn b) noexcept nogil:
    cdef Turn t
    t.c = a.c * b.c - a.s * b.s
    t.s = a.s * b.c + a.c * b.s
    return t


cdef inline Turn any_turn(uint64_t seed) noexcept nogil:
    """Return a rotation as if by chance, without sine and cosine, which differ between processors:
    a point of the disk, on the way out.
    """
    cdef Turn t
    cdef double size = 0.0
    while not 0.01 <= size <= 1.0:
        t.c = 2.0 * uniform(mixed(seed)) - 1.0
        t.s = 2.0 * uniform(mixed(seed + 1)) - 1.0
        size = t.c * t.c + t.s * t.s
        seed += 2
    size = 1.0 / sqrt(size)
    t.c *= size
    t.s *= size
    return t


cdef inline Axes axes_of(Vec z) noexcept nogil:
    """Return axes around a unit vector (Duff et al., Building an orthonormal basis, revisited)."""
    cdef Axes a
    cdef double sign = 1.0 if z.z >= 0.0 else -1.0
    cdef double p = -1.0 / (sign + z.z)
    cdef double q = z.x * z.y * p
    a.x = vec(1.0 + sign * z.x * z.x * p, sign * q, -sign * z.x)
    a.y = vec(q, sign + z.y * z.y * p, -z.y)
    a.z = z
    return a


@cython.final
cdef class Outlook:
    """Makes the rays from points: a spiral of directions for each, turned by the point's number.

    Directions are those of a Fibonacci lattice, on which each stands for the same part; a hash of
    the point's number turns it and moves it along, so that what two points miss is not the same.

    Parameters
    ----------
    rays : int
        A point, 1 or more.
    spread : int
        A `Spread`: AROUND, UNIFORM or COSINE.
    origin : (3,) float
        The store's, in world coordinates.
    bounds : (2, 3) float64
        The scene's, relative to it.

    """

    cdef double[:, ::1] azimuths
    cdef Spread spread
    cdef Vec origin
    cdef Bounds bounds

    def __cinit__(self, int rays, Spread spread, origin, const double[:, ::1] bounds):
        cdef Turn t, step
        cdef int k
        cdef double size
        self.azimuths = np.empty((rays, 2))
        self.spread = spread
        self.origin = vec(origin[0], origin[1], origin[2])
        self.bounds = bounds_of(bounds)
        t.c, t.s = 1.0, 0.0
        step.c, step.s = GOLDEN_COSINE, GOLDEN_SINE
        for k in range(rays):
            self.azimuths[k, 0], self.azimuths[k, 1] = t.c, t.s
            t = turned(t, step)
            size = 1.0 / sqrt(t.c * t.c + t.s * t.s)
            t.c *= size
            t.s *= size

    def fill(self, int64_t first, const double[:, ::1] points, const double[:, ::1] normals,
             double[:, ::1] origins, double[:, ::1] directions):
        """Make the rays of some points, one point's after another's.

        Parameters
        ----------
        first : int
            The number of the first point.
        points : (n, 3) float64
            IN. World coordinates.
        normals : (n, 3) float64
            IN. Of any length but zero: rays begin off the surface to this side, by the error that a
            hit there has. For AROUND they are not looked at.
        origins, directions : (n rays, 3) float64
            OUT. Unit directions; NaN for those around a normal of no length.
        """
        cdef int64_t i, each = self.azimuths.shape[0]
        cdef Vec p, n = vec(0.0, 0.0, 1.0)
        cdef double error
        with nogil:
            for i in range(points.shape[0]):
                p = vec(points[i, 0], points[i, 1], points[i, 2])
                if self.spread != AROUND:
                    n = vec(normals[i, 0], normals[i, 1], normals[i, 2])
                    scale_extreme(&n)
                    n = unit(n)
                    error = place_error(sub(p, self.origin), &self.bounds) + world_error(p)
                    p = along(p, n, error)
                self.look(<uint64_t>(first + i), p, n, &origins[i * each, 0],
                          &directions[i * each, 0])

    cdef void look(self, uint64_t number, Vec p, Vec n, double* origins,
                   double* directions) noexcept nogil:
        """Make the rays of a point."""
        cdef uint64_t seed = mixed(number)
        cdef double shift = uniform(mixed(seed + 1))
        cdef Turn turn = any_turn(seed + 2), t
        cdef Axes axes = axes_of(n)
        cdef int64_t k, each = self.azimuths.shape[0]
        cdef double part, up, out
        cdef Vec d
        for k in range(each):
            part = (k + shift) / each
            if self.spread == AROUND:
                up, out = 1.0 - 2.0 * part, 2.0 * sqrt(part * (1.0 - part))
            elif self.spread == UNIFORM:
                up, out = 1.0 - part, sqrt(part * (2.0 - part))
            else:
                up, out = sqrt(1.0 - part), sqrt(part)
            t.c, t.s = self.azimuths[k, 0], self.azimuths[k, 1]
            t = turned(t, turn)
            d = add(scale(axes.x, out * t.c), scale(axes.y, out * t.s))
            d = along(d, axes.z, up)
            directions[3 * k], directions[3 * k + 1], directions[3 * k + 2] = d.x, d.y, d.z
            origins[3 * k], origins[3 * k + 1], origins[3 * k + 2] = p.x, p.y, p.z
