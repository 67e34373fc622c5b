"""The marking loop."""

from libc.stdint cimport int64_t, uint8_t

from bfrt.geometry.box cimport box_empty
from bfrt.geometry.grid cimport HIGH, LOW, Grid, Range, box_range
from bfrt.geometry.lattice cimport Lattice
from bfrt.scene.sweep cimport Sweep, advance_block
from bfrt.streams.atomic cimport atomic_or


cdef void mark_face(const Grid* g, Range r, int axis, bint high, uint8_t* marks) noexcept nogil:
    """Mark the voxels of one side of a range for rays that enter by that side."""
    cdef int x, y, z
    cdef int64_t row
    cdef uint8_t bit = <uint8_t>(1 << ((HIGH if high else LOW) + axis))
    if high:
        r.lo[axis] = r.hi[axis]
    else:
        r.hi[axis] = r.lo[axis]
    for z in range(r.lo[2], r.hi[2] + 1):
        for y in range(r.lo[1], r.hi[1] + 1):
            row = g.n[0] * (y + g.n[1] * <int64_t>z)
            for x in range(r.lo[0], r.hi[0] + 1):
                atomic_or(&marks[row + x], bit)


def mark(Sweep sweep, int64_t n, Lattice lattice, uint8_t[::1] marks):
    """Mark where the regions of the next n objects of a sweep begin.

    Parameters
    ----------
    marks : (voxels,) uint8
        IN, OUT. Threads may share it.
    """
    cdef int axis, i, block
    cdef Range r
    with nogil:
        while n > 0:
            block = advance_block(sweep, n)
            n -= block
            for i in range(block):
                if box_empty(&sweep.box[i]):
                    continue
                box_range(&lattice.grid, &sweep.box[i], &r)
                for axis in range(3):
                    mark_face(&lattice.grid, r, axis, False, &marks[0])
                    mark_face(&lattice.grid, r, axis, True, &marks[0])
