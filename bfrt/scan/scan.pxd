"""One worker's cursors over one stream: over its boxes, geometry, materials and ids."""

from libc.stdint cimport int64_t, uint64_t

from bfrt.records cimport INDEX_BITS
from bfrt.scan.boxes cimport BoxCursor, next_boxes
from bfrt.scan.column cimport ColumnCursor
from bfrt.scan.geometry cimport GeometryCursor, next_records, vertices_in


cdef class StreamScan:
    cdef readonly BoxCursor boxes
    cdef readonly GeometryCursor geometry
    cdef readonly ColumnCursor materials
    cdef readonly ColumnCursor ids
    cdef readonly int kind
    cdef readonly int number
    cdef readonly bint lazy
    cdef readonly bint deferred  # whether geometry is read later than boxes, and of few objects
    cdef bint in_step   # whether it is read with them, of all objects
    cdef int64_t records_read


cdef inline int next_block(StreamScan s, int64_t most) except -1 nogil:
    """Come to the next objects: boxes, and records where these are read in step; return n >= 1."""
    if s.in_step:
        most = next_records(s.geometry, most)
    elif not s.lazy:
        s.records_read += min(most, 8)
    return next_boxes(s.boxes, most)


cdef inline uint64_t object_id(StreamScan s, int i) noexcept nogil:
    """Return the id of object i of the block."""
    return (<uint64_t>s.number << INDEX_BITS) + <uint64_t>(s.boxes.first + i)


cdef inline const unsigned char* record_in_block(StreamScan s, int i) noexcept nogil:
    """Return the record of object i of the block; it stays in place until the next block. Not for a
    scan that reads geometry later.
    """
    if s.in_step:
        return s.geometry.block + i * s.geometry.stride
    s.records_read += s.lazy
    return s.boxes.records + i * s.boxes.bytes
