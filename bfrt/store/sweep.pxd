"""A sweep over one stream's objects: box and geometry of each, in order, without the GIL."""

from libc.stdint cimport int64_t, uint8_t, uint16_t, uint32_t
from libc.string cimport memcpy

from bfrt.geometry.box cimport Box
from bfrt.geometry.coordinates cimport Frame
from bfrt.geometry.eight cimport BOXES, Eight, eight_clear, eight_of, eight_union
from bfrt.geometry.quantised cimport Coding, coded_union, coding_in, eight_decoded
from bfrt.geometry.sphere cimport sphere_boxes, sphere_union
from bfrt.records cimport BOX_BYTES, CODE_BYTES, OFFSET_BYTES, POLYGON, SPHERE
from bfrt.streams.reader cimport Reader, skip, take, want


cdef class Sweep:
    cdef Reader geometry
    cdef Reader boxes      # None for spheres, whose record is their box
    cdef Reader quantised  # None where there are no such boxes
    cdef Reader offsets    # None for all but polygons
    cdef Reader materials  # None where all objects have one material
    cdef readonly int kind
    cdef readonly int number
    cdef readonly tuple tapes
    cdef tuple readers
    cdef Frame frame
    cdef int64_t stride
    cdef readonly bint lazy
    cdef readonly bint delays  # whether geometry is read later than boxes, and of few objects
    cdef bint coded        # whether boxes are read quantised, since `rewind`
    cdef Reader box_reader  # where they are
    cdef int64_t box_bytes  # and of how many bytes
    cdef int64_t index     # of the next object
    cdef uint32_t vertex   # polygons: where the one before it ends
    cdef int64_t fetched   # of the next object, or vertex, in the geometry
    cdef uint32_t material  # the one, where all have it
    cdef int material_bytes
    cdef int64_t material_at  # the object whose material is read next, by `pick_material`
    cdef int64_t material_known  # the end of those that it has asked for
    cdef const int64_t[::1] outliers
    cdef Py_ssize_t outlier
    cdef readonly int64_t geometry_read  # objects whose geometry was read
    cdef int64_t wanted    # the end of the ranges whose boxes are being read
    cdef const int64_t[:, ::1] objects  # that are picked
    cdef const int64_t[:, ::1] picked   # their records, or vertices: of each where from and to
    cdef int64_t picking   # of these, the next
    cdef int64_t known     # the end of records that were asked for
    cdef Coding coding     # how boxes are quantised in the range that `advance_to` came to
    # The block that `advance_block` came to:
    cdef int64_t first     # its first object
    cdef uint32_t ends[BOXES + 1]  # polygons: where each begins, in vertices, and the last ends
    cdef const unsigned char* record  # their records, but where geometry is read later
    cdef uint32_t count    # vertices of the polygon that `fetch` gave
    cdef Eight eight       # their boxes, once `decode` was called
    cdef const uint8_t* codes  # what these are coded as

    cpdef int window(self, int64_t first, int64_t last) except -1
    cdef int64_t end_of(self, int64_t index) except -1
    cpdef int material_window(self, int64_t first, int64_t last) except -1
    cdef object vertices_of(self, const int64_t[:, ::1] ranges)
    cdef int refuse(self, int64_t vertex) except -1 nogil


cdef inline int64_t run_end(const int64_t[:, ::1] ranges, int64_t* k, int64_t gap) noexcept nogil:
    """Where the ranges end that lie so near each other from range k on; k becomes the last."""
    while k[0] + 1 < ranges.shape[0] and ranges[k[0] + 1, 0] - ranges[k[0], 1] <= gap:
        k[0] += 1
    return ranges[k[0], 1]


cdef inline int advance_to(Sweep s, const int64_t[:, ::1] ranges, int64_t k,
                           const Box* parent) except -1 nogil:
    """Go forward to the first object of range k, of those in the window; what lies between is
    skipped.

    Where boxes are quantised, they are so in the parent's. They are read as far as each range lies
    near the next, at once and no further.
    """
    cdef int64_t n = max(<int64_t>0, ranges[k, 0] - s.index)
    cdef bint far = ranges[k, 0] >= s.wanted
    if s.coded:
        coding_in(parent, &s.coding)
    if far:
        want_boxes(s, s.index)  # what comes before is not read through
    if n > 0:
        skip(s.box_reader, n * s.box_bytes)
        if s.kind == SPHERE:
            s.fetched += n
        elif s.kind == POLYGON:
            skip(s.offsets, (n - 1) * OFFSET_BYTES)
    if far:
        want_boxes(s, run_end(ranges, &k, s.box_reader.gap // s.box_bytes))
    if s.kind == POLYGON and n > 0:
        s.vertex = (<const uint32_t*>take(s.offsets, OFFSET_BYTES))[0]
    s.index += n
    return 0


cdef inline void want_boxes(Sweep s, int64_t end) noexcept nogil:
    """Know that boxes up to that object's will be looked at."""
    s.wanted = end
    want(s.box_reader, end * s.box_bytes)
    if s.offsets is not None:
        want(s.offsets, end * OFFSET_BYTES)


cdef inline int want_records(Sweep s, int64_t begin, int64_t end) except -1 nogil:
    """Go forward to a record (a vertex, of polygons) of the geometry: up to `end` all are read at
    once, and no further."""
    if begin < s.fetched:
        s.refuse(begin)
    want(s.geometry, s.fetched * s.stride)  # what comes before is not read through
    skip(s.geometry, (begin - s.fetched) * s.stride)
    s.fetched = begin
    want(s.geometry, end * s.stride)
    return 0


cdef inline const unsigned char* records_of(Sweep s, int64_t at, int64_t n) except NULL nogil:
    """The records (vertices, of polygons) [at, at + n) of the geometry."""
    if at < s.fetched:
        s.refuse(at)
    skip(s.geometry, (at - s.fetched) * s.stride)
    s.fetched = at + n
    return take(s.geometry, n * s.stride)


cdef inline const unsigned char* fetch(Sweep s, int i) noexcept nogil:
    """The record of object i of the block, which stays where it is until the next block; `count`
    too. Not of a sweep that delays."""
    s.geometry_read += s.lazy
    if s.kind == POLYGON:
        s.count = s.ends[i + 1] - s.ends[i]
    return s.record + i * s.stride


cdef inline int advance_records(Sweep s, int64_t most) except -1 nogil:
    """Come to the next objects, up to `most` and BOXES: their records alone; returns n >= 1.

    A sweep that delays only tells where they are. Of others polygons come one at a time, for
    their records are not of one size.
    """
    cdef int n = <int>(most if most < BOXES else BOXES)
    s.first = s.index
    if s.kind == POLYGON:
        n = n if s.delays else 1
        s.ends[0] = s.vertex
        memcpy(&s.ends[1], take(s.offsets, OFFSET_BYTES * n), OFFSET_BYTES * n)
        s.vertex = s.ends[n]
        if not s.delays:
            s.record = records_of(s, s.ends[0], s.ends[1] - s.ends[0])
    elif not s.delays:
        s.record = records_of(s, s.first, n)
    s.geometry_read += 0 if s.lazy else n
    s.index += n
    return n


cdef inline int advance_block(Sweep s, int64_t most) except -1 nogil:
    """Come to the next objects, up to `most` and BOXES: records and boxes; returns n >= 1.

    Boxes are known once `decode` is called: until then they are as they are coded, or the records
    of spheres.
    """
    cdef int n = advance_records(s, most)
    if s.coded:
        s.codes = take(s.quantised, CODE_BYTES * n)
    elif s.boxes is not None:
        eight_of(<const float*>take(s.boxes, BOX_BYTES * n), n, &s.eight)
    return n


cdef inline void block_union(Sweep s, int n, Box* all) noexcept nogil:
    """The box around the block's n objects, at least: around outliers, too."""
    if s.coded:
        coded_union(&s.coding, s.codes, n, <float*>all)
    elif s.boxes is not None:
        eight_union(&s.eight, <float*>all)
    else:
        sphere_union(s.record, s.stride, &s.frame, n, all)


cdef inline void decode(Sweep s, int n) noexcept nogil:
    """Have the boxes of the block's n objects in `eight`, of outliers empty ones."""
    if s.coded:
        eight_decoded(&s.coding, s.codes, n, &s.eight)
    elif s.boxes is None:
        sphere_boxes(s.record, s.stride, &s.frame, n, &s.eight)
    clear_outliers(s)


cdef inline void clear_outliers(Sweep s) noexcept nogil:
    """Rays meet them before they enter the grid."""
    while s.outlier < s.outliers.shape[0] and s.outliers[s.outlier] < s.index:
        if s.outliers[s.outlier] >= s.first:
            eight_clear(&s.eight, <int>(s.outliers[s.outlier] - s.first))
        s.outlier += 1


cdef inline int advance(Sweep s) except -1 nogil:
    """Come to the next object, and its record."""
    advance_block(s, 1)
    s.record = fetch(s, 0)
    return 0


cdef inline const unsigned char* pick(Sweep s) except NULL nogil:
    """The record of the next object of those that were said to be picked; `count` too."""
    cdef int64_t k = s.picking
    cdef int64_t begin = s.picked[k, 0]
    cdef int64_t n = s.picked[k, 1] - begin
    if begin >= s.known:
        s.known = run_end(s.picked, &k, s.geometry.gap // s.stride)
        want_records(s, begin, s.known)
    s.count = <uint32_t>n
    s.picking += 1
    s.geometry_read += 1
    return records_of(s, begin, n)


cdef inline int advance_materials(Sweep s, int n, uint32_t* materials) except -1 nogil:
    """Come to the materials of the next n <= BOXES objects."""
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


cdef inline uint32_t pick_material(Sweep s) except? 0xFFFFFFFF nogil:
    """The material of the object that `pick` takes next."""
    cdef uint32_t material
    cdef int64_t k = s.picking
    cdef int64_t index = s.objects[k, 0]
    cdef bint far = index >= s.material_known
    if s.materials is not None:
        if far:
            want(s.materials, s.material_at * s.material_bytes)
        skip(s.materials, (index - s.material_at) * s.material_bytes)
        if far:
            s.material_known = run_end(s.objects, &k, s.materials.gap // s.material_bytes)
            want(s.materials, s.material_known * s.material_bytes)
    s.material_at = index + 1
    advance_materials(s, 1, &material)
    return material
