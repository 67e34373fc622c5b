"""Boxes of records: the writer's loop."""

from libc.math cimport isfinite
from libc.stdint cimport int64_t, uint32_t

from bfrt.geometry.box cimport Box, box_clear
from bfrt.geometry.coordinates cimport Frame, number
from bfrt.geometry.shape cimport Shape, shape_bounds, shape_load
from bfrt.geometry.vector cimport vec
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
        IN. Vertices of each polygon; of no use for other kinds, which have (n,) of anything.
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
