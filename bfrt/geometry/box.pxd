"""Bounding boxes: float32 and rounded outwards on disk, float64 when they are met.

A box without a point (lo > hi) belongs to a degenerate object, which nothing ever meets.
"""

from libc.math cimport INFINITY

from bfrt.geometry.vector cimport Line, Vec, larger, smaller

cdef extern from *:
    """
    #include <stdint.h>
    #include <string.h>
    /* The largest float32 that is not above x. Inline and without a branch on which way x was
       rounded: a library call a coordinate would be most of what a sphere's box costs, and the way
       is a coin's fall. */
    static inline float bfrt_below(double x) {
        float f = (float)x;
        int32_t bits;
        if (f == 0.0f)
            return x < 0.0 ? -0x1p-149f : f;
        memcpy(&bits, &f, 4);
        bits += ((double)f > x) * (2 * (bits < 0) - 1);
        memcpy(&f, &bits, 4);
        return f;
    }
    """
    float below "bfrt_below"(double x) noexcept nogil

# The sides of a box: LOW + axis, HIGH + axis.
cdef enum:
    LOW = 0
    HIGH = 3

cdef packed struct Box:
    float lo[3]
    float hi[3]

cdef struct PaddedBox:
    double lo[3]
    double hi[3]

cdef struct Span:
    double near
    double far


cdef inline float above(double x) noexcept nogil:
    """Return the smallest float32 that is not below x."""
    return -below(-x)


cdef inline void box_clear(Box* b) noexcept nogil:
    cdef int k
    for k in range(3):
        b.lo[k] = INFINITY
        b.hi[k] = -INFINITY


cdef inline bint box_empty(const Box* b) noexcept nogil:
    return b.lo[0] > b.hi[0] or b.lo[1] > b.hi[1] or b.lo[2] > b.hi[2]


cdef inline void box_between(Box* b, Vec lo, Vec hi) noexcept nogil:
    """Make the box from lo to hi, rounded outwards."""
    b.lo[0], b.lo[1], b.lo[2] = below(lo.x), below(lo.y), below(lo.z)
    b.hi[0], b.hi[1], b.hi[2] = above(hi.x), above(hi.y), above(hi.z)


cdef inline void box_add(Box* all, const Box* b) noexcept nogil:
    """Grow a box around another, that may be empty."""
    cdef int k
    for k in range(3):
        all.lo[k] = b.lo[k] if b.lo[k] < all.lo[k] else all.lo[k]
        all.hi[k] = b.hi[k] if b.hi[k] > all.hi[k] else all.hi[k]


cdef inline bint slab_axis(double lo, double hi, double o, double inv, Span* s) noexcept nogil:
    """Narrow the span of t to lo <= o + t d <= hi on one axis (rules 2 and 4)."""
    cdef double a, b
    if inv == 0.0:
        return lo <= o <= hi
    a = (lo - o) * inv
    b = (hi - o) * inv
    s.near = larger(smaller(a, b), s.near)
    s.far = smaller(larger(a, b), s.far)
    return s.near <= s.far


cdef inline void box_pad(const Box* b, double padding, PaddedBox* g) noexcept nogil:
    """Pad a box on all sides: the box that rays meet."""
    cdef int k
    for k in range(3):
        g.lo[k] = b.lo[k] - padding
        g.hi[k] = b.hi[k] + padding


cdef inline bint padded_span(const PaddedBox* g, const Line* r, Span* s) noexcept nogil:
    """Find where the line, from t = 0 on, is inside the padded box; false for nowhere."""
    s.near = 0.0
    s.far = INFINITY
    return (
        slab_axis(g.lo[0], g.hi[0], r.o.x, r.inv.x, s)
        and slab_axis(g.lo[1], g.hi[1], r.o.y, r.inv.y, s)
        and slab_axis(g.lo[2], g.hi[2], r.o.z, r.inv.z, s)
    )


cdef inline bint box_span(const Box* b, double padding, const Line* r, Span* s) noexcept nogil:
    """Find where the line is inside a box that is padded for this test alone."""
    cdef PaddedBox g
    box_pad(b, padding, &g)
    return padded_span(&g, r, s)
