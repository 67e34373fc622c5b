"""Rays that have met a box, and wait for the object's geometry.

The paper reads geometry only where a ray meets its box (section 3.1). Ours is not read at once,
either: what is needed is gathered, and prefetched in pieces with the short gaps between, so that
many requests are under way while boxes go on being tested.

::

    half    |DELAYED ...            |    is filled, and its geometry prefetched
    half    |DELAYED DELAYED ...    |    its geometry is on its way: settled when the other is full
"""

from libc.stdint cimport int64_t, uint64_t

from bfrt.geometry.box cimport PaddedBox
from bfrt.geometry.shape cimport Shape
from bfrt.records cimport NO_HIT, Delayed
from bfrt.streams.reader cimport Reader

cdef enum:
    HALF = 4096           # delayed rays
    UNDER_WAY = 1 << 20   # bytes that a half prefetches, about: they are in the page cache
    PIECE = 1 << 18       # and at once


cdef class DeferredTests:
    cdef Delayed[:, ::1] halves
    cdef int64_t count[2]
    cdef int half         # that is filled
    cdef int64_t begin    # bytes of the piece that grows: it is prefetched when it ends
    cdef int64_t end
    cdef int64_t prefetched   # bytes, by the half that is filled
    cdef uint64_t loaded  # the object whose geometry is at hand, or NO_HIT
    cdef bint degenerate
    cdef Shape shape
    cdef double padding   # by which boxes are padded when rays meet them
    cdef PaddedBox own    # its box
    cdef int64_t known    # the end of the records that are being read


cdef inline bint full(DeferredTests d) noexcept nogil:
    return d.count[d.half] == HALF or d.prefetched >= UNDER_WAY


cdef inline void delay(DeferredTests d, Reader geometry, int64_t size,
                       const Delayed* wait) noexcept nogil:
    """Have a ray wait for an object, whose records of `size` bytes are behind all before."""
    d.halves[d.half, d.count[d.half]] = wait[0]
    d.count[d.half] += 1
    grow_piece(d, geometry, wait.first * size, (wait.first + wait.count) * size)


cdef inline void grow_piece(DeferredTests d, Reader geometry, int64_t begin,
                            int64_t end) noexcept nogil:
    cdef bint near = begin <= d.end + geometry.gap
    if not near or d.end - d.begin >= PIECE:
        prefetch_piece(d, geometry)
        d.begin = d.end if near else begin
    if end > d.end:
        d.end = end


cdef inline void prefetch_piece(DeferredTests d, Reader geometry) noexcept nogil:
    """Prefetch the piece that grows; the next record begins another."""
    if d.end > d.begin:
        geometry.prefetch(d.begin, d.end)
        d.prefetched += d.end - d.begin
    d.begin = d.end


cdef inline void turn(DeferredTests d) noexcept nogil:
    """Begin to fill the other half, which has been settled."""
    d.half = 1 - d.half
    d.count[d.half] = d.prefetched = 0


cdef inline void end_delays(DeferredTests d) noexcept nogil:
    """End a sweep whose delays are all settled, to be ready for another."""
    d.count[0] = d.count[1] = d.half = 0
    d.begin = d.end = d.prefetched = d.known = 0
    d.loaded = NO_HIT


cdef inline int64_t piece_end(const Delayed* waits, int64_t n, int64_t gap) noexcept nogil:
    """Return the end of the records, from the first object on, that gaps of `gap` at most part."""
    cdef int64_t i, end = waits[0].first + waits[0].count
    for i in range(1, n):
        if waits[i].first > end + gap:
            break
        end = max(end, waits[i].first + waits[i].count)
    return end
