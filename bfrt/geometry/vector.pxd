"""Vectors of three doubles, and the line that a kernel meets: only + - * / and sqrt."""

from libc.math cimport fabs, isfinite, sqrt

cdef extern from *:
    """
    /* One instruction each; of a NaN the second argument is left. */
    static inline double bfrt_smaller(double a, double b) { return a < b ? a : b; }
    static inline double bfrt_larger(double a, double b) { return a > b ? a : b; }
    """
    double smaller "bfrt_smaller"(double a, double b) noexcept nogil
    double larger "bfrt_larger"(double a, double b) noexcept nogil

cdef struct Vec:
    double x
    double y
    double z

# A ray without its bookkeeping. inv is 1 / d, computed once for every use (exactness rule 2 of
# docs/algorithm.rst); it is 0 where the axis never steps: d is 0, or so small that 1 / d overflows
# (rule 4).
cdef struct Line:
    Vec o
    Vec d
    Vec inv


cdef inline Vec vec(double x, double y, double z) noexcept nogil:
    cdef Vec v
    v.x = x
    v.y = y
    v.z = z
    return v


cdef inline Vec add(Vec a, Vec b) noexcept nogil:
    return vec(a.x + b.x, a.y + b.y, a.z + b.z)


cdef inline Vec sub(Vec a, Vec b) noexcept nogil:
    return vec(a.x - b.x, a.y - b.y, a.z - b.z)


cdef inline Vec scale(Vec a, double s) noexcept nogil:
    return vec(a.x * s, a.y * s, a.z * s)


cdef inline Vec along(Vec o, Vec d, double t) noexcept nogil:
    return vec(o.x + t * d.x, o.y + t * d.y, o.z + t * d.z)


cdef inline Vec lowest(Vec a, Vec b) noexcept nogil:
    return vec(smaller(a.x, b.x), smaller(a.y, b.y), smaller(a.z, b.z))


cdef inline Vec highest(Vec a, Vec b) noexcept nogil:
    return vec(larger(a.x, b.x), larger(a.y, b.y), larger(a.z, b.z))


cdef inline double dot(Vec a, Vec b) noexcept nogil:
    return a.x * b.x + a.y * b.y + a.z * b.z


cdef inline Vec cross(Vec a, Vec b) noexcept nogil:
    return vec(a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x)


cdef inline double length(Vec a) noexcept nogil:
    return sqrt(dot(a, a))


cdef inline Vec unit(Vec a) noexcept nogil:
    return scale(a, 1.0 / length(a))


cdef inline double largest(Vec a) noexcept nogil:
    """Return the largest magnitude of a component."""
    return larger(fabs(a.x), larger(fabs(a.y), fabs(a.z)))


cdef inline double inverse(double d) noexcept nogil:
    cdef double inv = 1.0 / d
    return inv if isfinite(inv) else 0.0


cdef inline Line line(Vec o, Vec d) noexcept nogil:
    cdef Line r
    r.o = o
    r.d = d
    r.inv = vec(inverse(d.x), inverse(d.y), inverse(d.z))
    return r
