"""Runs: ranges of records that are read as one, for the gaps between are short."""

from libc.stdint cimport int64_t

from bfrt.streams.reader cimport Reader


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
        reader.ask(begin, run_end(ranges, &k, reader.gap // size) * size)
        k += 1
