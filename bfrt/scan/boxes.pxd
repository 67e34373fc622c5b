"""A cursor over the boxes of one stream's objects: in order, eight at a time, in chosen ranges.

::

    exact       float32 boxes, as the writer made them
    quantised   the same in 6 bytes, inside a box of the hierarchy
    records     the objects', of which boxes are worked out: spheres, and objects in spatial order
"""

from libc.stdint cimport int64_t, uint8_t, uint32_t

from bfrt.geometry.box cimport Box
from bfrt.geometry.coordinates cimport Frame
from bfrt.geometry.packet cimport BOXES, BoxPacket, eight_clear, eight_of, eight_union
from bfrt.geometry.quantised cimport Coding, coded_union, coding_in, eight_decoded
from bfrt.geometry.shape cimport shape_boxes
from bfrt.geometry.sphere cimport sphere_boxes, sphere_union
from bfrt.records cimport BOX_BYTES, CODE_BYTES, OFFSET_BYTES, SPHERE
from bfrt.scan.runs cimport run_end, take_ends
from bfrt.streams.reader cimport Reader, read_ahead, skip, take


cdef class BoxCursor:
    cdef Reader exact       # each None where there is none
    cdef Reader quantised
    cdef Reader geometry    # where boxes are worked out of records
    cdef Reader offsets     # polygons whose geometry is read later: where each ends; else None
    cdef Reader reader      # of the first three, the one that is read
    cdef int64_t bytes      # of a box there
    cdef readonly bint coded    # whether it is the second
    cdef readonly int number    # the stream's
    cdef int kind
    cdef Frame frame
    cdef const int64_t[::1] outliers
    cdef Py_ssize_t outlier
    cdef int64_t index      # the object that comes next
    cdef uint32_t vertex    # polygons: where the one before it ends
    cdef int64_t largest    # and vertices of one at the most
    cdef int64_t vertices   # and of all
    cdef int64_t ahead      # the end of the ranges whose boxes are being read
    cdef Coding coding      # how boxes are quantised in the range that `go_to` came to
    # The block that `next_boxes` came to:
    cdef int64_t first      # its first object
    cdef uint32_t ends[BOXES + 1]   # polygons: where each begins, in vertices, and the last ends
    cdef const unsigned char* records   # where boxes are worked out of them
    cdef const uint8_t* codes   # of quantised boxes
    cdef BoxPacket eight        # the boxes, once `decode` was called

    cpdef int window(self, int64_t first, int64_t last) except -1
    cdef int refuse_ends(self, int n) except -1 nogil


cdef inline int go_to(BoxCursor b, const int64_t[:, ::1] ranges, int64_t k,
                      const Box* parent) except -1 nogil:
    """Go forward to the first object of range k of the window, and skip the objects between.

    Quantised boxes are decoded inside the parent's box. Boxes are read at once as far as each range
    lies near the next one, and no further.
    """
    cdef int64_t n = max(<int64_t>0, ranges[k, 0] - b.index)
    cdef bint far = ranges[k, 0] >= b.ahead
    if b.coded:
        coding_in(parent, &b.coding)
    if far:
        read_boxes_ahead(b, b.index)  # what comes before is not read through
    if n > 0:
        skip(b.reader, n * b.bytes)
        if b.offsets is not None:
            skip(b.offsets, (n - 1) * OFFSET_BYTES)
    if far:
        read_boxes_ahead(b, run_end(ranges, &k, b.reader.gap // b.bytes))
    if b.offsets is not None and n > 0:
        b.vertex = (<const uint32_t*>take(b.offsets, OFFSET_BYTES))[0]
    b.index += n
    return 0


cdef inline void read_boxes_ahead(BoxCursor b, int64_t end) noexcept nogil:
    """Have boxes read up to that object's."""
    b.ahead = end
    read_ahead(b.reader, end * b.bytes)
    if b.offsets is not None:
        read_ahead(b.offsets, end * OFFSET_BYTES)


cdef inline int next_boxes(BoxCursor b, int64_t most) except -1 nogil:
    """Come to the next objects, up to `most` and BOXES; return how many, n >= 1.

    Boxes are known once `decode` is called: until then they are as they are on disk.
    """
    cdef int n = <int>(most if most < BOXES else BOXES)
    b.first = b.index
    if b.offsets is not None:
        b.ends[0] = b.vertex
        if not take_ends(b.offsets, b.ends, n, b.largest, b.vertices):
            b.refuse_ends(n)
        b.vertex = b.ends[n]
    if b.coded:
        b.codes = take(b.quantised, CODE_BYTES * n)
    elif b.geometry is not None:
        b.records = take(b.geometry, b.bytes * n)
    else:
        eight_of(<const float*>take(b.exact, BOX_BYTES * n), n, &b.eight)
    b.index += n
    return n


cdef inline void block_union(BoxCursor b, int n, Box* all) noexcept nogil:
    """Compute a box around the block's n objects; it may reach around outliers, too."""
    if b.coded:
        coded_union(&b.coding, b.codes, n, <float*>all)
    elif b.geometry is None:
        eight_union(&b.eight, <float*>all)
    elif b.kind == SPHERE:
        sphere_union(b.records, b.bytes, &b.frame, n, all)
    else:
        shape_boxes(b.kind, b.records, b.bytes, &b.frame, n, &b.eight)
        eight_union(&b.eight, <float*>all)


cdef inline void decode(BoxCursor b, int n) noexcept nogil:
    """Have the boxes of the block's n objects in `eight`, of outliers empty ones."""
    if b.coded:
        eight_decoded(&b.coding, b.codes, n, &b.eight)
    elif b.geometry is not None:
        if b.kind == SPHERE:
            sphere_boxes(b.records, b.bytes, &b.frame, n, &b.eight)
        else:
            shape_boxes(b.kind, b.records, b.bytes, &b.frame, n, &b.eight)
    clear_outliers(b)


cdef inline void clear_outliers(BoxCursor b) noexcept nogil:
    """Clear the boxes of outliers: rays meet these before they enter the grid."""
    while b.outlier < b.outliers.shape[0] and b.outliers[b.outlier] < b.index:
        if b.outliers[b.outlier] >= b.first:
            eight_clear(&b.eight, <int>(b.outliers[b.outlier] - b.first))
        b.outlier += 1
