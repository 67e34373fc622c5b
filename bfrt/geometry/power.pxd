"""x to the y from + - * / alone, so that a highlight is the same on every processor."""

from libc.math cimport floor, frexp, ldexp


cdef inline double log2_of(double x) noexcept nogil:
    """Return log2 of a positive x: exponent + 2/ln 2 atanh((m - 1) / (m + 1)), m near 1."""
    cdef int exponent
    cdef double m = frexp(x, &exponent)
    cdef double s, s2, total = 0.0
    cdef int k
    if m < 0.70710678118654752:
        m *= 2.0
        exponent -= 1
    s = (m - 1.0) / (m + 1.0)
    s2 = s * s
    for k in range(23, 0, -2):  # |s| < 0.172: the next term is below 2^-62
        total = total * s2 + 1.0 / k
    return exponent + total * s * 2.8853900817779268


cdef inline double exp2_of(double x) noexcept nogil:
    """Return 2 to the x: 2^round(x) times the series of e^(f ln 2), |f| <= 1/2."""
    cdef double whole = floor(x + 0.5)
    cdef double f = (x - whole) * 0.69314718055994531
    cdef double total = 1.0
    cdef int k
    if x < -1080.0:
        return 0.0
    if x > 1024.0:
        whole = 2000.0
    for k in range(16, 0, -1):
        total = 1.0 + total * f / k
    return ldexp(total, <int>whole)


cdef inline double power(double x, double y) noexcept nogil:
    """Return x^y for x in [0, 1] or so, and y >= 0; 0^0 is 1, as in C."""
    if y == 0.0:
        return 1.0
    if x <= 0.0:
        return 0.0
    return exp2_of(y * log2_of(x))
