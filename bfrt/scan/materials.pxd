"""A cursor over the materials of one stream: of all objects in order, or of picked ones."""

from libc.stdint cimport int64_t, uint16_t, uint32_t

from bfrt.scan.runs cimport run_end
from bfrt.streams.reader cimport Reader, read_ahead, skip, take


cdef class MaterialCursor:
    cdef Reader reader      # None where all objects have one
    cdef uint32_t one       # which that is
    cdef int bytes          # of a material
    cdef int64_t at         # the object whose material comes next
    cdef int64_t known      # the end of those that were prefetched
    cdef const int64_t[:, ::1] objects  # that are picked
    cdef int64_t picking    # the next of them


cdef inline uint32_t next_material(MaterialCursor m) except? 0xFFFFFFFF nogil:
    """Give the material of the next object."""
    cdef const unsigned char* p
    m.at += 1
    if m.reader is None:
        return m.one
    p = take(m.reader, m.bytes)
    if m.bytes == 1:
        return p[0]
    if m.bytes == 2:
        return (<const uint16_t*>p)[0]
    return (<const uint32_t*>p)[0]


cdef inline uint32_t pick_material(MaterialCursor m) except? 0xFFFFFFFF nogil:
    """Return the material of the next picked object."""
    cdef int64_t k = m.picking
    cdef int64_t index = m.objects[k, 0]
    cdef bint far = index >= m.known
    m.picking += 1
    if m.reader is not None:
        if far:
            read_ahead(m.reader, m.at * m.bytes)
        skip(m.reader, (index - m.at) * m.bytes)
        if far:
            m.known = run_end(m.objects, &k, m.reader.gap // m.bytes)
            read_ahead(m.reader, m.known * m.bytes)
    m.at = index
    return next_material(m)
