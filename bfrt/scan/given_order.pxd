"""Which of two objects that are hit at the same t comes first: the one that was given first.

Where objects are stored in the order given, their ids tell. Where they are in spatial order each
has its place in the id that rays carry, and its given place is read from the file when a tie asks
for it, which is seldom.
"""

from libc.stdint cimport int64_t, uint64_t

from bfrt.records cimport INDEX_BITS


cdef class GivenOrder:
    cdef list files
    cdef int[::1] fd        # by stream number: of the ids' file, -1 where the order is that given
    cdef int[::1] bytes     # of an id there
    cdef readonly int failed    # the system's error, of a read that failed

    cdef int64_t given_place(self, uint64_t id) noexcept nogil


cdef inline bint comes_first(GivenOrder order, uint64_t id, uint64_t other) noexcept nogil:
    """Tell whether an object was given before another."""
    cdef uint64_t stream = id >> INDEX_BITS
    if stream != other >> INDEX_BITS or order.fd[stream] < 0:
        return id < other
    return order.given_place(id) < order.given_place(other)
