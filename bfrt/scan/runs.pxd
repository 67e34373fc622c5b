"""Runs: ranges of records that are read as one, for the gaps between are short; and the offsets of
polygons."""

from libc.stdint cimport int64_t, uint32_t
from libc.string cimport memcpy

from bfrt.records cimport OFFSET_BYTES
from bfrt.streams.reader cimport Reader, take


cdef inline int64_t run_end(const int64_t[:, ::1] ranges, int64_t* k, int64_t gap) noexcept nogil:
    """Find where the ranges end that lie so near each other from range k on; k becomes the last."""
    while k[0] + 1 < ranges.shape[0] and ranges[k[0] + 1, 0] - ranges[k[0], 1] <= gap:
        k[0] += 1
    return ranges[k[0], 1]


cdef inline void prefetch_runs(Reader reader, const int64_t[:, ::1] ranges,
                               int64_t size) noexcept nogil:
    """Have the system begin to read runs of records of `size` bytes."""
    cdef int64_t begin, k = 0
    while k < ranges.shape[0]:
        begin = ranges[k, 0] * size
        reader.prefetch(begin, run_end(ranges, &k, reader.gap // size) * size)
        k += 1


cdef inline int64_t polygon_end(Reader offsets, int64_t index) except -1:
    """Find where polygon `index` ends, in vertices: one read, beside those in order. -1 ends at 0.
    """
    cdef Reader single
    if index < 0:
        return 0
    single = Reader(offsets.file, OFFSET_BYTES)
    single.window(index * OFFSET_BYTES, (index + 1) * OFFSET_BYTES)
    return (<const uint32_t*>take(single, OFFSET_BYTES))[0]


cdef inline int take_ends(Reader offsets, uint32_t* ends, int n, int64_t largest,
                          int64_t vertices) except -1 nogil:
    """Take where the next n polygons end, behind ends[0], where the first begins.

    Returns
    -------
    int
        Whether they can end there: each has `largest` vertices at the most, of `vertices` in all.
    """
    cdef bint good
    cdef int i
    memcpy(&ends[1], take(offsets, OFFSET_BYTES * n), OFFSET_BYTES * n)
    good = ends[n] <= vertices
    for i in range(n):
        good &= <uint32_t>(ends[i + 1] - ends[i]) <= largest  # one that descends comes round
    return good
