"""Rays in flight: their memory, and the loops that all accelerators share."""

from libc.stdint cimport int64_t

from bfrt.image.film cimport Film
from bfrt.records cimport Hit, Path, Ray


cdef class RaysInFlight:
    cdef readonly int64_t active
    cdef readonly int64_t capacity
    cdef object memory
    cdef object records
    cdef object path_records
    cdef Ray[::1] rays
    cdef Path[::1] paths

    cdef object free(self)
    cdef bint complete(self, const Ray* r) noexcept nogil
    cdef object let_go(self, int64_t first, int64_t last, Film film, const double[::1] background,
                       Hit[::1] hits)
