"""A sweep over one stream's objects: box and geometry of each, in order, without the GIL."""

from libc.stdint cimport int64_t, uint32_t

from bfrt.geometry.box cimport Box
from bfrt.geometry.coordinates cimport Frame
from bfrt.streams.reader cimport Reader


cdef class Sweep:
    cdef Reader geometry
    cdef Reader boxes      # None for spheres, whose record is their box
    cdef Reader offsets    # None for all but polygons
    cdef Reader materials  # None where all objects have one material
    cdef readonly int kind
    cdef readonly int number
    cdef readonly tuple tapes
    cdef Frame frame
    cdef size_t stride
    cdef int64_t index     # of the next object
    cdef uint32_t vertex   # polygons: where the last one ended
    cdef uint32_t material # the one, or that of the last object
    cdef int material_bytes
    cdef const int64_t[::1] outliers
    cdef Py_ssize_t outlier
    # The object that `advance` came to:
    cdef const unsigned char* record
    cdef uint32_t count
    cdef Box box

    cpdef int window(self, int64_t first, int64_t last) except -1
    cdef int64_t end_of(self, int64_t index) except -1
    cpdef int material_window(self, int64_t first, int64_t last) except -1
    cdef int advance(self) except -1 nogil
    cdef int advance_material(self) except -1 nogil
