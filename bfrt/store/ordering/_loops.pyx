"""The loops of ordering: places along a curve, and objects gathered in another order.

And what gives memory back that the allocator keeps, before ordering takes its own.
"""

from libc.stdint cimport int64_t, uint8_t, uint32_t, uint64_t
from libc.string cimport memcpy

from bfrt.geometry.box cimport Box, box_empty

cdef extern from *:
    """
    #include <stdlib.h>
    #if defined(__GLIBC__)
    #include <malloc.h>
    static void bfrt_give_back(void) { (void)malloc_trim(0); }
    #else
    static void bfrt_give_back(void) {}
    #endif
    """
    void trim "bfrt_give_back"() noexcept nogil

#: Bits of a code on each axis, at the most.
MOST_BITS = 21


cdef inline uint64_t spread(uint64_t x) noexcept nogil:
    """Put two zero bits behind each of 21 bits."""
    x = (x | x << 32) & <uint64_t>0x1f00000000ffffULL
    x = (x | x << 16) & <uint64_t>0x1f0000ff0000ffULL
    x = (x | x << 8) & <uint64_t>0x100f00f00f00f00fULL
    x = (x | x << 4) & <uint64_t>0x10c30c30c30c30c3ULL
    return (x | x << 2) & <uint64_t>0x1249249249249249ULL


cdef inline uint64_t cell(double center, double low, double scale, uint64_t last) noexcept nogil:
    """Return the cell of a coordinate, from 0 to last."""
    cdef double at = (center - low) * scale
    if not at > 0.0:
        return 0
    return last if at >= <double>last else <uint64_t>at


def codes_of(const float[:, ::1] boxes, low, scale, int bits, uint64_t[::1] codes):
    """Compute where the centers of boxes are along a Morton curve.

    Parameters
    ----------
    boxes : (n, 6) float32
        IN. Empty ones come last.
    low, scale : sequence of 3 float
        The least coordinate on each axis, and the cells in a unit of length.
    bits : int
        Bits of a cell's number on each axis, up to MOST_BITS.
    codes : (n,) uint64
        OUT. Of 3 bits, each.
    """
    cdef double x = low[0], y = low[1], z = low[2]
    cdef double sx = scale[0], sy = scale[1], sz = scale[2]
    cdef uint64_t last = (<uint64_t>1 << bits) - 1
    cdef uint64_t end = (<uint64_t>1 << 3 * bits) - 1
    cdef const Box* b
    cdef int64_t i
    with nogil:
        for i in range(codes.shape[0]):
            b = <const Box*>&boxes[i, 0]
            if box_empty(b):
                codes[i] = end
                continue
            codes[i] = (
                spread(cell(0.5 * b.lo[0] + 0.5 * b.hi[0], x, sx, last)) << 2
                | spread(cell(0.5 * b.lo[1] + 0.5 * b.hi[1], y, sy, last)) << 1
                | spread(cell(0.5 * b.lo[2] + 0.5 * b.hi[2], z, sz, last))
            )


def gather(const uint8_t[::1] records, size_t stride, const uint32_t[::1] order, uint8_t[::1] out):
    """Gather records of `stride` bytes in another order."""
    cdef int64_t i
    with nogil:
        for i in range(order.shape[0]):
            memcpy(&out[i * stride], &records[order[i] * stride], stride)


def gather_runs(const uint8_t[::1] records, size_t stride, const int64_t[::1] ends,
                const uint32_t[::1] order, uint8_t[::1] out):
    """Gather runs of records: that of object i ends at ends[i], where that of i + 1 begins."""
    cdef int64_t i, begin, n, at = 0
    cdef uint32_t k
    with nogil:
        for i in range(order.shape[0]):
            k = order[i]
            begin = ends[k - 1] if k > 0 else 0
            n = (ends[k] - begin) * <int64_t>stride
            if n:
                memcpy(&out[at], &records[begin * stride], n)
            at += n


def give_back():
    """Give the system the memory back that the allocator keeps, where it does (glibc)."""
    with nogil:
        trim()
