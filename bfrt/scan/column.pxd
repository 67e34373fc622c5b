"""A cursor over one number for each object of a stream, of all in order, or of picked ones: its
material in the palette, or the place that it had as it was given.
"""

from libc.stdint cimport int64_t, uint16_t, uint32_t, uint64_t

from bfrt.scan.runs cimport run_end
from bfrt.streams.reader cimport Reader, read_ahead, skip, take


cdef class ColumnCursor:
    cdef Reader reader      # None where nothing is stored: all objects have one number, or
    cdef bint placed        # each has its place
    cdef uint64_t one
    cdef uint64_t base      # is added to what is stored
    cdef int bytes          # of a number
    cdef int64_t at         # the object whose number comes next
    cdef int64_t known      # the end of those that were prefetched
    cdef const int64_t[:, ::1] objects  # that are picked
    cdef int64_t picking    # the next of them


cdef inline uint64_t next_number(ColumnCursor c) except? 0xFFFFFFFFFFFFFFFF nogil:
    """Give the number of the next object."""
    cdef const unsigned char* p
    c.at += 1
    if c.reader is None:
        return <uint64_t>(c.at - 1) if c.placed else c.one
    p = take(c.reader, c.bytes)
    if c.bytes == 1:
        return c.base + p[0]
    if c.bytes == 2:
        return c.base + (<const uint16_t*>p)[0]
    if c.bytes == 4:
        return c.base + (<const uint32_t*>p)[0]
    return c.base + (<const uint64_t*>p)[0]


cdef inline uint64_t pick_number(ColumnCursor c) except? 0xFFFFFFFFFFFFFFFF nogil:
    """Return the number of the next picked object."""
    cdef int64_t k = c.picking
    cdef int64_t index = c.objects[k, 0]
    cdef bint far = index >= c.known
    c.picking += 1
    if c.reader is not None:
        if far:
            read_ahead(c.reader, c.at * c.bytes)
        skip(c.reader, (index - c.at) * c.bytes)
        if far:
            c.known = run_end(c.objects, &k, c.reader.gap // c.bytes)
            read_ahead(c.reader, c.known * c.bytes)
    c.at = index
    return next_number(c)
