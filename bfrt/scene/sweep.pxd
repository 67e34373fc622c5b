"""A sweep over one stream's objects: box and geometry of each, in order, without the GIL."""

from libc.stdint cimport int64_t, uint16_t, uint32_t
from libc.string cimport memcpy

from bfrt.geometry.box cimport Box, box_clear
from bfrt.geometry.coordinates cimport Frame
from bfrt.geometry.sphere cimport Sphere, sphere_bounds, sphere_load
from bfrt.records cimport POLYGON
from bfrt.streams.reader cimport Reader, take

cdef enum:
    BOX_BYTES = 24
    OFFSET_BYTES = 4
    BLOCK = 8  # objects that a loop looks at together


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
    cdef uint32_t material  # the one, or that of the last object
    cdef int material_bytes
    cdef const int64_t[::1] outliers
    cdef Py_ssize_t outlier
    # The objects that `advance_block` came to:
    cdef const unsigned char* record
    cdef uint32_t count    # vertices, of a polygon
    cdef Box box[BLOCK]

    cpdef int window(self, int64_t first, int64_t last) except -1
    cdef int64_t end_of(self, int64_t index) except -1
    cpdef int material_window(self, int64_t first, int64_t last) except -1


cdef inline int advance_block(Sweep s, int64_t most) except -1 nogil:
    """Come to the next objects, up to `most` and BLOCK: their records and boxes; returns n >= 1.

    Polygons, whose records are not of one size, come one at a time.
    """
    cdef uint32_t end
    cdef int i, n = <int>(most if most < BLOCK else BLOCK)
    cdef Sphere sphere
    s.count = 0
    if s.kind == POLYGON:
        n = 1
        end = (<const uint32_t*>take(s.offsets, OFFSET_BYTES))[0]
        s.count = end - s.vertex
        s.vertex = end
        s.record = take(s.geometry, s.stride * s.count)
    else:
        s.record = take(s.geometry, s.stride * n)
    if s.boxes is not None:
        memcpy(&s.box[0], take(s.boxes, BOX_BYTES * n), BOX_BYTES * n)
    else:
        for i in range(n):
            if sphere_load(s.record + i * s.stride, &s.frame, &sphere):
                sphere_bounds(&sphere, &s.box[i])
            else:
                box_clear(&s.box[i])
    while s.outlier < s.outliers.shape[0] and s.outliers[s.outlier] < s.index + n:
        box_clear(&s.box[s.outliers[s.outlier] - s.index])
        s.outlier += 1
    s.index += n
    return n


cdef inline int advance(Sweep s) except -1 nogil:
    """Come to the next object."""
    return advance_block(s, 1)


cdef inline int advance_material(Sweep s) except -1 nogil:
    """Come to the next object's material."""
    cdef const unsigned char* p
    if s.materials is None:
        return 0
    p = take(s.materials, s.material_bytes)
    if s.material_bytes == 1:
        s.material = p[0]
    elif s.material_bytes == 2:
        s.material = (<const uint16_t*>p)[0]
    else:
        s.material = (<const uint32_t*>p)[0]
    return 0
