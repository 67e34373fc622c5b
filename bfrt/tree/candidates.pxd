"""The candidates of a pass: pairs of a ray and a treelet, as they are found, and by treelet."""

from libc.stdint cimport int64_t, uint32_t, uint64_t

cdef enum:
    RAY_SHIFT = 32      # a candidate: the treelet above, the ray below


cdef class Candidates:
    cdef uint64_t[::1] found
    cdef uint32_t[::1] rays
    cdef int64_t used
    cdef int64_t[::1] place
    cdef int64_t[::1] starts
    cdef uint32_t[::1] treelets

    cdef inline void add(self, int64_t at, uint32_t treelet, int64_t ray) noexcept nogil:
        """Set a candidate whose place was reserved by counting up `used`."""
        self.found[at] = <uint64_t>treelet << RAY_SHIFT | <uint64_t>ray

    cdef int64_t sort(self) noexcept nogil
