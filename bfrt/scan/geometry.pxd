"""A cursor over the geometry of one stream: records in order, or of objects that are picked.

Of polygons a record is a vertex, and objects have several: `offsets` tells where each ends.
"""

from libc.stdint cimport int64_t, uint32_t

from bfrt.geometry.coordinates cimport Frame
from bfrt.geometry.packet cimport BOXES
from bfrt.records cimport OFFSET_BYTES
from bfrt.scan.runs cimport run_end, take_ends
from bfrt.streams.reader cimport Reader, read_ahead, skip, take


cdef class GeometryCursor:
    cdef Reader reader
    cdef Reader offsets     # None for all but polygons
    cdef readonly int kind
    cdef bint counted       # whether objects have several records: vertices
    cdef readonly int number    # the stream's
    cdef Frame frame
    cdef int64_t stride     # bytes of a record
    cdef bint prefetched    # whether what is read is prefetched
    cdef int64_t at         # the record that comes next
    cdef int64_t index      # the object whose offset comes next
    cdef uint32_t vertex    # where the polygon before it ends
    cdef int64_t largest    # vertices of a polygon at the most
    cdef int64_t vertices   # of all polygons
    cdef readonly int64_t objects_read
    # The block that `next_records` came to:
    cdef const unsigned char* block
    cdef uint32_t ends[BOXES + 1]  # polygons: where each begins, in vertices, and the last ends
    # The objects that are picked:
    cdef const int64_t[:, ::1] ranges   # of records, one range each
    cdef int64_t picking    # the next of them
    cdef int64_t known      # the end of records that were prefetched
    cdef readonly uint32_t count    # vertices of the polygon that was picked last

    cpdef int window(self, int64_t first, int64_t last) except -1
    cdef (int64_t, int64_t) place(self, int64_t first, int64_t last) except *
    cdef object vertices_of(self, const int64_t[:, ::1] ranges)
    cdef int refuse(self, int64_t vertex) except -1 nogil
    cdef int refuse_end(self, int64_t index, const uint32_t* ends) except -1 nogil


cdef inline int seek_records(GeometryCursor g, int64_t begin, int64_t end) except -1 nogil:
    """Go forward to a record: up to `end` all are read at once, and no further."""
    if begin < g.at:
        g.refuse(begin)
    read_ahead(g.reader, g.at * g.stride)  # what comes before is not read through
    skip(g.reader, (begin - g.at) * g.stride)
    g.at = begin
    read_ahead(g.reader, end * g.stride)
    return 0


cdef inline const unsigned char* records_of(GeometryCursor g, int64_t at,
                                            int64_t n) except NULL nogil:
    """Give the records [at, at + n), which stay where they are until the next are given."""
    if at < g.at:
        g.refuse(at)
    skip(g.reader, (at - g.at) * g.stride)
    g.at = at + n
    return take(g.reader, n * g.stride)


cdef inline int next_records(GeometryCursor g, int64_t most) except -1 nogil:
    """Come to the next objects of the window, up to `most` and BOXES; return how many, n >= 1.

    Polygons come one at a time, for their records are not of one size.
    """
    cdef int n = <int>(most if most < BOXES else BOXES)
    if g.counted:
        n = 1
        g.ends[0] = g.vertex
        if not take_ends(g.offsets, g.ends, 1, g.largest, g.vertices):
            g.refuse_end(g.index, g.ends)
        g.vertex = g.ends[1]
        g.block = records_of(g, g.ends[0], g.ends[1] - g.ends[0])
    else:
        g.block = records_of(g, g.index, n)
    g.index += n
    g.objects_read += n
    return n


cdef inline uint32_t vertices_in(GeometryCursor g, int i) noexcept nogil:
    """Count the vertices of polygon i of the block; of other kinds 0."""
    return g.ends[i + 1] - g.ends[i] if g.counted else 0


cdef inline const unsigned char* pick_record(GeometryCursor g) except NULL nogil:
    """Return the record of the next picked object; set `count` too."""
    cdef int64_t k = g.picking
    cdef int64_t begin = g.ranges[k, 0]
    cdef int64_t n = g.ranges[k, 1] - begin
    if begin >= g.known:
        g.known = run_end(g.ranges, &k, g.reader.gap // g.stride)
        seek_records(g, begin, g.known)
    g.count = <uint32_t>n
    g.picking += 1
    g.objects_read += 1
    return records_of(g, begin, n)
