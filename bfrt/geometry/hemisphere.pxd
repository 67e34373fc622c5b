"""Directions of a hemisphere, from + - * / and sqrt alone: the same on every processor."""

from libc.math cimport copysign, floor, sqrt

from bfrt.geometry.vector cimport Vec, add, scale, vec

cdef struct Basis:
    Vec x
    Vec y
    Vec z

cdef struct Turn:
    double cosine
    double sine


cdef inline Basis basis_around(Vec z) noexcept nogil:
    """Return two unit vectors at right angles to a unit z, and to each other.

    After Duff et al., "Building an orthonormal basis, revisited" (2017): without a branch.
    """
    cdef Basis b
    cdef double sign = copysign(1.0, z.z)
    cdef double a = -1.0 / (sign + z.z)
    cdef double c = z.x * z.y * a
    b.x = vec(1.0 + sign * z.x * z.x * a, sign * c, -sign * z.x)
    b.y = vec(c, sign + z.y * z.y * a, -z.y)
    b.z = z
    return b


cdef inline Turn turn_of(double part) noexcept nogil:
    """Return cosine and sine of a part of a full turn, in [0, 1].

    The nearest quarter is taken off; of what is left, pi/4 at the most, the series end below 2^-54.
    """
    cdef double quarter = floor(4.0 * part + 0.5)
    cdef double x = (part - 0.25 * quarter) * 6.2831853071795865
    cdef double x2 = x * x, c = 1.0, s = 1.0
    cdef Turn t
    cdef int k
    for k in range(16, 0, -2):
        c = 1.0 - x2 / (k * (k - 1)) * c
        s = 1.0 - x2 / (k * (k + 1)) * s
    s *= x
    k = <int>quarter & 3
    t.cosine = c if k == 0 else -s if k == 1 else -c if k == 2 else s
    t.sine = s if k == 0 else c if k == 1 else -s if k == 2 else -c
    return t


cdef inline Vec cosine_direction(const Basis* b, double u, double v) noexcept nogil:
    """Return a unit direction around z for u and v in [0, 1).

    Where both are uniform, directions are as dense as their cosine to z (Malley's method: a disk's
    points, put up on the hemisphere).
    """
    cdef Turn t = turn_of(v)
    cdef double r = sqrt(u)
    return add(
        add(scale(b.x, r * t.cosine), scale(b.y, r * t.sine)), scale(b.z, sqrt(1.0 - u))
    )
