"""The marking loop."""

from libc.stdint cimport int64_t, uint8_t

from bfrt.geometry.box cimport box_empty
from bfrt.geometry.grid cimport HIGH, LOW, Grid, Range, box_range
from bfrt.geometry.lattice cimport Lattice
from bfrt.phases.subspace cimport Subspace
from bfrt.scene.sweep cimport Sweep, advance_block, advance_to
from bfrt.streams.atomic cimport atomic_or


cdef void mark_face(const Grid* g, Subspace s, Range r, int axis, bint high,
                    uint8_t* marks) noexcept nogil:
    """Mark the voxels of one side of a range for rays that enter by that side.

    The range is cut to the subspace when its sides are known, or the subspace's own would be
    marked (rule 10).
    """
    cdef uint8_t bit = <uint8_t>(1 << ((HIGH if high else LOW) + axis))
    cdef int a = g.order[0], b = g.order[1], c = g.order[2]
    cdef int k, i, j, layer
    cdef int64_t row
    if high:
        r.lo[axis] = r.hi[axis]
    else:
        r.hi[axis] = r.lo[axis]
    for k in range(3):
        r.lo[k] = max(r.lo[k], s.range.lo[k])
        r.hi[k] = min(r.hi[k], s.range.hi[k])
    for layer in range(r.lo[c], r.hi[c] + 1):
        for j in range(r.lo[b], r.hi[b] + 1):
            row = (layer - s.range.lo[c]) * s.stride[c] + (j - s.range.lo[b]) * s.stride[b]
            for i in range(r.lo[a] - s.range.lo[a], r.hi[a] - s.range.lo[a] + 1):
                atomic_or(&marks[row + i], bit)


def mark(Sweep sweep, const int64_t[:, ::1] ranges, Lattice lattice, Subspace subspace,
         uint8_t[:, :, ::1] marks):
    """Mark where the regions of objects of a sweep begin, as far as that is in the subspace.

    Parameters
    ----------
    ranges : (n, 2) int64
        IN. First and end of runs of objects, ascending, in the sweep's window.
    marks : (layers, rows, row) uint8
        IN, OUT. The subspace's voxels. Threads may share it.
    """
    cdef int axis, i, block
    cdef int64_t k
    cdef Range r
    with nogil:
        for k in range(ranges.shape[0]):
            advance_to(sweep, ranges[k, 0])
            while sweep.index < ranges[k, 1]:
                block = advance_block(sweep, ranges[k, 1] - sweep.index)
                for i in range(block):
                    if box_empty(&sweep.box[i]):
                        continue
                    box_range(&lattice.grid, &sweep.box[i], &r)
                    for axis in range(3):
                        mark_face(&lattice.grid, subspace, r, axis, False, &marks[0, 0, 0])
                        mark_face(&lattice.grid, subspace, r, axis, True, &marks[0, 0, 0])
