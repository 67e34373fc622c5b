"""The slab in memory and the table of all bricks, as walks look them up."""

from libc.stdint cimport int32_t, int64_t, uint8_t

from bfrt.grid.bricks cimport BRICK, BRICK_BYTES, BRICK_SHIFT
from bfrt.grid.planes cimport Planes
from bfrt.grid.grid cimport Grid

cdef struct Slab:
    const Planes* planes
    int number
    int axis                # across the slabs
    const int32_t* table    # where each brick is, of the whole grid
    int64_t stride[3]       # of a brick in the table, an axis
    int shift[3]            # of a voxel in its brick, an axis
    const int32_t* slab_of  # the slab of each layer of bricks
    const uint8_t* bricks
    int64_t first_brick     # the number of the first of them


cdef class Slabs:
    cdef readonly Grid grid
    cdef readonly int count
    cdef readonly object table
    cdef readonly object slab_of
    cdef Slab slab
    cdef const int32_t[:, :, ::1] table_view
    cdef const int32_t[::1] layers
    cdef uint8_t[:, ::1] bricks
    cdef object memory
    cdef object marks
    cdef object workers
    cdef list firsts        # the first layer of each slab, and the one beyond the last
    cdef int64_t bytes_read


cdef inline int32_t brick_at(const Slab* s, const int* at) noexcept nogil:
    """Return the index of the brick that a voxel is in, or EMPTY_BRICK, or EMPTY_CUBE."""
    return s.table[
        (at[0] >> BRICK_SHIFT) * s.stride[0] + (at[1] >> BRICK_SHIFT) * s.stride[1]
        + (at[2] >> BRICK_SHIFT) * s.stride[2]
    ]


cdef inline uint8_t mark_at(const Slab* s, int64_t brick, const int* at) noexcept nogil:
    """Return the marks of a voxel of a brick."""
    return s.bricks[
        (brick - s.first_brick) * BRICK_BYTES + ((at[0] & (BRICK - 1)) << s.shift[0])
        + ((at[1] & (BRICK - 1)) << s.shift[1]) + ((at[2] & (BRICK - 1)) << s.shift[2])
    ]
