"""Boxes of records, and what all of them together reach: the writer's loops."""

cimport cython
from libc.float cimport DBL_MAX, FLT_MAX
from libc.math cimport INFINITY, fabs
from libc.stdint cimport int64_t, uint32_t, uint64_t

import numpy as np

from bfrt.geometry.box cimport Box, box_add, box_clear
from bfrt.geometry.coordinates cimport Frame, number
from bfrt.geometry.shape cimport Shape, shape_bounds, shape_load
from bfrt.geometry.vector cimport larger, vec
from bfrt.records cimport PATCH

from bfrt.records import Kind

cpdef enum:
    LARGEST = 64  # boxes kept aside while a group is written

cdef enum:
    NORMALS = 9   # numbers of a patch before its normals

ctypedef fused scalar:
    float
    double

# Objects of one kind as they lie in memory; of polygons, how many vertices each has.
cdef struct Block:
    int kind
    bint counted          # whether objects have several records: vertices
    Frame frame
    const unsigned char* records
    int64_t scalars       # of an object; of a polygon's vertex
    const uint32_t* counts

# A box among the largest: they are ordered by size, the square of the diagonal, then by id.
cdef struct Large:
    double size
    uint64_t id
    Box box


cdef bint up_to(double most, const unsigned char* record, int64_t first, int64_t end,
                bint wide) noexcept nogil:
    """Tell whether numbers of a record are no larger than the most, as none is that is NaN."""
    cdef int64_t i
    for i in range(first, end):
        if not fabs(number(record, i, wide)) <= most:
            return False
    return True


cdef int64_t bound_all(const Block* block, Box* boxes, int64_t n,
                       int64_t* degenerate) noexcept nogil:
    """Compute n boxes and count degenerate objects; return the first that is bad, or -1."""
    cdef Shape shape
    cdef const unsigned char* record = block.records
    cdef bint wide = block.frame.wide
    cdef int64_t i, numbers, size = 8 if wide else 4
    for i in range(n):
        numbers = block.scalars
        if block.counted:
            numbers *= block.counts[i]
        if not up_to(DBL_MAX, record, 0, numbers, wide):
            return i
        # Of normals, which are in no box, the squares have to be finite too.
        if block.kind == PATCH and not up_to(FLT_MAX, record, NORMALS, numbers, wide):
            return i
        if shape_load(block.kind, record, block.counts[i], &block.frame, &shape):
            shape_bounds(&shape, &boxes[i])
            if not up_to(FLT_MAX, <const unsigned char*>&boxes[i], 0, 6, False):
                return i
        else:
            box_clear(&boxes[i])
            degenerate[0] += 1
        record += numbers * size
    return -1


def bound(int kind, const scalar[:, ::1] records, const uint32_t[::1] counts, origin,
          float[:, ::1] boxes):
    """Compute the boxes of a block of records.

    Parameters
    ----------
    kind : int
        The primitive kind.
    records : (n, scalars) float32 or float64
        IN. One object a row; for polygons one vertex a row.
    counts : (n,) uint32
        IN. Number of vertices of each polygon; for other kinds (n,) of anything, not used.
    origin : sequence of 3 float
        Taken off float64 coordinates.
    boxes : (n, 6) float32
        OUT. lo and hi, relative to the origin; inf and -inf for a degenerate object.

    Returns
    -------
    degenerate : int
        Objects that nothing can hit.
    bad : int
        Index of the first record that is not finite, or whose box is not; -1 for none.
    """
    cdef Block block
    cdef int64_t degenerate = 0, bad
    block.kind, block.counted = kind, Kind(kind).counted
    block.frame.wide = scalar is double
    block.frame.origin = vec(origin[0], origin[1], origin[2])
    block.records = <const unsigned char*>&records[0, 0] if records.shape[0] else NULL
    block.scalars = records.shape[1]
    block.counts = &counts[0] if counts.shape[0] else NULL
    with nogil:
        bad = bound_all(&block, <Box*>&boxes[0, 0] if boxes.shape[0] else NULL, boxes.shape[0],
                        &degenerate)
    return degenerate, bad


def around(const float[:, ::1] boxes):
    """Return the box around boxes (n, 6), (6,) float64; inf and -inf for none."""
    cdef Box box
    cdef int64_t i
    box_clear(&box)
    with nogil:
        for i in range(boxes.shape[0]):
            box_add(&box, <const Box*>&boxes[i, 0])
    return np.array(sides_of(&box))


def around_points(const float[:, ::1] points):
    """Return the box around points (n, 3), (6,) float64; inf and -inf for none."""
    cdef float lo[3]
    cdef float hi[3]
    cdef int64_t i
    cdef int k
    for k in range(3):
        lo[k], hi[k] = INFINITY, -INFINITY
    with nogil:
        for i in range(points.shape[0]):
            for k in range(3):
                lo[k] = min(lo[k], points[i, k])
                hi[k] = max(hi[k], points[i, k])
    return np.array([lo[0], lo[1], lo[2], hi[0], hi[1], hi[2]])


cdef inline bint before(const Large* one, const Large* other) noexcept nogil:
    """Tell whether a box comes before another among the largest."""
    return one.size > other.size or (one.size == other.size and one.id < other.id)


cdef inline double size_of(const Box* box) noexcept nogil:
    """Return the square of a box's diagonal; 0 where it holds no point."""
    cdef double x = larger(<double>box.hi[0] - box.lo[0], 0.0)
    cdef double y = larger(<double>box.hi[1] - box.lo[1], 0.0)
    cdef double z = larger(<double>box.hi[2] - box.lo[2], 0.0)
    return x * x + y * y + z * z


cdef list sides_of(const Box* box):
    return [box.lo[0], box.lo[1], box.lo[2], box.hi[0], box.hi[1], box.hi[2]]


@cython.final
cdef class LargestBoxes:
    """Keeps the `LARGEST` largest of many boxes, and one box around all others."""

    cdef Large largest[LARGEST]  # the first `count`, the largest first
    cdef int count
    cdef Box rest                # around the others

    def __cinit__(self):
        box_clear(&self.rest)

    def add(self, const float[:, ::1] boxes, uint64_t first):
        """Take in more boxes.

        Parameters
        ----------
        boxes : (n, 6) float32
            IN. lo and hi; inf and -inf for a degenerate object.
        first : int
            The first one's id; the others' follow.
        """
        cdef Large one
        cdef Large* at
        cdef int64_t i
        with nogil:
            for i in range(boxes.shape[0]):
                one.box = (<const Box*>&boxes[i, 0])[0]
                one.size = size_of(&one.box)
                one.id = first + <uint64_t>i
                if self.count == LARGEST:
                    if not before(&one, &self.largest[LARGEST - 1]):
                        box_add(&self.rest, &one.box)
                        continue
                    box_add(&self.rest, &self.largest[LARGEST - 1].box)
                    self.count -= 1
                at = &self.largest[self.count]
                while at > &self.largest[0] and before(&one, at - 1):
                    at[0] = (at - 1)[0]
                    at -= 1
                at[0] = one
                self.count += 1

    @property
    def ids(self):
        """Return the ids of the largest boxes, (count,) uint64, the largest first."""
        return np.array([self.largest[i].id for i in range(self.count)], np.uint64)

    @property
    def boxes(self):
        """Return the largest boxes, (count, 6) float32, the largest first."""
        boxes = [sides_of(&self.largest[i].box) for i in range(self.count)]
        return np.array(boxes, np.float32).reshape(-1, 6)

    @property
    def rest(self):
        """Return the box around all others, (6,) float64; inf and -inf for none."""
        return np.array(sides_of(&self.rest))
