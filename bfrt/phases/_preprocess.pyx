"""The marking loop."""

from libc.stdint cimport int64_t, uint8_t

from bfrt.geometry.box cimport box_empty
from bfrt.geometry.grid cimport (
    DARK, DARK_SHIFT, DARKER, DARKER_SHIFT, HIGH, LOW, Grid, Range, box_range,
)
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


cdef bint dark(const Grid* g, const uint8_t* marks, const int* lo, const int* hi) noexcept nogil:
    """Whether no voxel from lo to hi (exclusive) has a mark."""
    cdef int x, y, z
    cdef int64_t row
    for z in range(lo[2], hi[2]):
        for y in range(lo[1], hi[1]):
            row = g.n[0] * (y + g.n[1] * <int64_t>z)
            for x in range(lo[0], hi[0]):
                if marks[row + x] & (DARK - 1):
                    return False
    return True


cdef void darken_cubes(const Grid* g, uint8_t* marks, int z, int shift, uint8_t bit) noexcept nogil:
    """Set `bit` in all voxels of those cubes of a layer, which begins at z, that have no mark."""
    cdef int lo[3]
    cdef int hi[3]
    cdef int x, y, cube_x, cube_y
    cdef int64_t row
    lo[2] = z
    hi[2] = min(z + (1 << shift), g.n[2])
    for cube_y in range((g.n[1] - 1 >> shift) + 1):
        lo[1] = cube_y << shift
        hi[1] = min(lo[1] + (1 << shift), g.n[1])
        for cube_x in range((g.n[0] - 1 >> shift) + 1):
            lo[0] = cube_x << shift
            hi[0] = min(lo[0] + (1 << shift), g.n[0])
            if not dark(g, marks, &lo[0], &hi[0]):
                continue
            for z in range(lo[2], hi[2]):
                for y in range(lo[1], hi[1]):
                    row = g.n[0] * (y + g.n[1] * <int64_t>z)
                    for x in range(lo[0], hi[0]):
                        marks[row + x] |= bit


def darken(uint8_t[::1] marks, Lattice lattice, int first, int last):
    """Tell walks where there is nothing: set the bits DARK and DARKER of marks.

    Parameters
    ----------
    marks : (voxels,) uint8
        IN, OUT.
    first, last : int
        Layers of cubes of 16 voxels a side.
    """
    cdef int layer, z
    with nogil:
        for layer in range(first, last):
            z = layer << DARKER_SHIFT
            darken_cubes(&lattice.grid, &marks[0], z, DARKER_SHIFT, DARKER)
            while z < min((layer + 1) << DARKER_SHIFT, lattice.grid.n[2]):
                darken_cubes(&lattice.grid, &marks[0], z, DARK_SHIFT, DARK)
                z += 1 << DARK_SHIFT
