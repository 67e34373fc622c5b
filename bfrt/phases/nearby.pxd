"""Whether any ray waits where a box is: what most boxes, and most parents, are passed over by."""

from libc.stdint cimport uint64_t

from bfrt.geometry.box cimport Box, box_empty
from bfrt.geometry.grid cimport Grid, roughly
from bfrt.phases.voxel_rays cimport BRICK_BITS, VoxelRays, brick_word, range_word

cdef enum:
    FEW = 12  # voxels a side of which the bricks are looked at one by one


cdef inline bint rays_near(const Box* b, const Grid* g, VoxelRays v) noexcept nogil:
    """Whether any voxel that a box may touch holds a ray.

    Arithmetic with some slack, in place of the table: it never misses a voxel of the range.
    """
    cdef int lo[3]
    cdef int hi[3]
    cdef int k, x, y, z, side = 0
    cdef uint64_t word
    if box_empty(b):
        return False
    for k in range(3):
        lo[k] = roughly(g, k, b.lo[k], -g.slack[k])
        hi[k] = roughly(g, k, b.hi[k], g.slack[k])
        side = max(side, hi[k] - lo[k])
    if side > FEW:
        return v.any_within(&lo[0], &hi[0])
    for z in range(lo[2] >> BRICK_BITS, (hi[2] >> BRICK_BITS) + 1):
        for y in range(lo[1] >> BRICK_BITS, (hi[1] >> BRICK_BITS) + 1):
            for x in range(lo[0] >> BRICK_BITS, (hi[0] >> BRICK_BITS) + 1):
                word = brick_word(v, x, y, z)
                if word and word & range_word(&lo[0], &hi[0], x, y, z):
                    return True
    return False
