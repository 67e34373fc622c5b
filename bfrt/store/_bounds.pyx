"""Boxes of records, and what all of them together reach: the writer's loops."""

from libc.math cimport isfinite
from libc.stdint cimport int64_t, uint32_t, uint64_t
from libc.string cimport memcpy

from bfrt.geometry.box cimport Box, box_clear
from bfrt.geometry.coordinates cimport Frame, number
from bfrt.geometry.shape cimport Shape, shape_bounds, shape_load
from bfrt.geometry.vector cimport larger, smaller, vec
from bfrt.records cimport POLYGON


cdef bint finite(const unsigned char* record, int64_t n, bint wide) noexcept nogil:
    cdef int64_t i
    for i in range(n):
        if not isfinite(number(record, i, wide)):
            return False
    return True


def bound(int kind, const unsigned char[::1] geometry, const uint32_t[::1] counts, bint wide,
          origin, int scalars, float[:, ::1] boxes):
    """Compute the boxes of a block of records.

    Parameters
    ----------
    kind : int
        The primitive kind.
    geometry : (bytes,) uint8
        IN. The records, float64 if `wide`, else float32.
    counts : (n,) uint32
        IN. Number of vertices of each polygon; for other kinds (n,) of anything, not used.
    origin : sequence of 3 float
        Taken off wide coordinates.
    scalars : int
        Numbers in a record (in a vertex, for polygons).
    boxes : (n, 6) float32
        OUT. lo and hi, relative to the origin; inf and -inf for a degenerate object.

    Returns
    -------
    degenerate : int
        Objects that nothing can hit.
    bad : int
        Index of the first record that is not finite, or whose box is not; -1 for none.
    """
    cdef Frame frame
    cdef Shape shape
    cdef Box* box
    cdef const unsigned char* record = &geometry[0] if geometry.shape[0] else NULL
    cdef int64_t i, n = boxes.shape[0], numbers, degenerate = 0, bad
    cdef int64_t size = 8 if wide else 4
    frame.wide = wide
    frame.origin = vec(origin[0], origin[1], origin[2])
    with nogil:
        for i in range(n):
            numbers = scalars * <int64_t>counts[i] if kind == POLYGON else scalars
            if not finite(record, numbers, wide):
                bad = i
                break
            box = <Box*>&boxes[i, 0]
            if shape_load(kind, record, counts[i], &frame, &shape):
                shape_bounds(&shape, box)
                if not finite(<const unsigned char*>box, 6, False):
                    bad = i
                    break
            else:
                box_clear(box)
                degenerate += 1
            record += numbers * size
        else:
            bad = -1
    return degenerate, bad


cdef inline bint before(double size, uint64_t id, double other, uint64_t other_id) noexcept nogil:
    """Tell whether a box comes before another among the largest: by size, then by id."""
    return size > other or (size == other and id < other_id)


cdef inline double size_of(const float* box) noexcept nogil:
    """Return the square of a box's diagonal; 0 where it holds no point."""
    cdef double x = larger(<double>box[3] - box[0], 0.0)
    cdef double y = larger(<double>box[4] - box[1], 0.0)
    cdef double z = larger(<double>box[5] - box[2], 0.0)
    return x * x + y * y + z * z


cdef inline void reach(double* rest, const float* box) noexcept nogil:
    cdef int k
    for k in range(3):
        rest[k] = smaller(box[k], rest[k])
        rest[3 + k] = larger(box[3 + k], rest[3 + k])


def gather(const float[:, ::1] boxes, uint64_t first, double[::1] rest, double[::1] sizes,
           float[:, ::1] largest, uint64_t[::1] largest_ids, int count):
    """Keep the largest boxes, and take the others into bounds.

    Parameters
    ----------
    boxes : (n, 6) float32
        IN. lo and hi; inf and -inf for a degenerate object.
    first : int
        The first one's id; the others' follow.
    rest : (6,) float64
        IN, OUT. The bounds of all boxes that are not kept.
    sizes, largest, largest_ids : (room,) float64, (room, 6) float32, (room,) uint64
        IN, OUT. The boxes that are kept, the largest first.
    count : int
        Number of boxes kept so far.

    Returns
    -------
    count : int
    """
    cdef int64_t i
    cdef uint64_t id
    cdef int j, room = <int>sizes.shape[0]
    cdef double size
    with nogil:
        for i in range(boxes.shape[0]):
            size = size_of(&boxes[i, 0])
            id = first + <uint64_t>i
            if count == room:
                if not before(size, id, sizes[room - 1], largest_ids[room - 1]):
                    reach(&rest[0], &boxes[i, 0])
                    continue
                reach(&rest[0], &largest[room - 1, 0])
                count -= 1
            j = count
            while j > 0 and before(size, id, sizes[j - 1], largest_ids[j - 1]):
                sizes[j] = sizes[j - 1]
                memcpy(&largest[j, 0], &largest[j - 1, 0], 6 * sizeof(float))
                largest_ids[j] = largest_ids[j - 1]
                j -= 1
            sizes[j] = size
            memcpy(&largest[j, 0], &boxes[i, 0], 6 * sizeof(float))
            largest_ids[j] = id
            count += 1
    return count
