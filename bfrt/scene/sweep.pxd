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
    cdef uint32_t material  # the one, where all have it
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


cdef inline int advance_records(Sweep s, int64_t most) except -1 nogil:
    """Come to the next objects, up to `most` and BLOCK: their records alone; returns n >= 1.

    Polygons, whose records are not of one size, come one at a time.
    """
    cdef uint32_t end
    cdef int n = <int>(most if most < BLOCK else BLOCK)
    s.count = 0
    if s.kind == POLYGON:
        n = 1
        end = (<const uint32_t*>take(s.offsets, OFFSET_BYTES))[0]
        s.count = end - s.vertex
        s.vertex = end
        s.record = take(s.geometry, s.stride * s.count)
    else:
        s.record = take(s.geometry, s.stride * n)
    s.index += n
    return n


cdef inline int advance_block(Sweep s, int64_t most) except -1 nogil:
    """Come to the next objects, up to `most` and BLOCK: records and boxes; returns n >= 1."""
    cdef int n = advance_records(s, most)
    cdef int64_t first = s.index - n
    cdef int i
    cdef Sphere sphere
    if s.boxes is not None:
        memcpy(&s.box[0], take(s.boxes, BOX_BYTES * n), BOX_BYTES * n)
    else:
        for i in range(n):
            if sphere_load(s.record + i * s.stride, &s.frame, &sphere):
                sphere_bounds(&sphere, &s.box[i])
            else:
                box_clear(&s.box[i])
    while s.outlier < s.outliers.shape[0] and s.outliers[s.outlier] < s.index:
        box_clear(&s.box[s.outliers[s.outlier] - first])
        s.outlier += 1
    return n


cdef inline int advance(Sweep s) except -1 nogil:
    """Come to the next object."""
    return advance_block(s, 1)


cdef inline int advance_materials(Sweep s, int n, uint32_t* materials) except -1 nogil:
    """Come to the materials of the next n <= BLOCK objects."""
    cdef const unsigned char* p
    cdef int i
    if s.materials is None:
        for i in range(n):
            materials[i] = s.material
        return 0
    p = take(s.materials, s.material_bytes * n)
    for i in range(n):
        if s.material_bytes == 1:
            materials[i] = p[i]
        elif s.material_bytes == 2:
            materials[i] = (<const uint16_t*>p)[i]
        else:
            materials[i] = (<const uint32_t*>p)[i]
    return 0
