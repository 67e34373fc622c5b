"""Whether any ray waits where a box is: what most boxes, and most parents, are passed over by."""

from bfrt.geometry.box cimport Box, box_empty
from bfrt.geometry.grid cimport Grid, Range, roughly
from bfrt.phases.voxel_rays cimport BRICK_BITS, VoxelRays, brick_within, uppers_of

cdef enum:
    FEW = 12  # upper voxels a side of which the bricks are looked at one by one


cdef inline bint rays_near(const Box* b, const Grid* g, VoxelRays v) noexcept nogil:
    """Whether any voxel that a box may touch holds a ray.

    Arithmetic with some slack, in place of the table: it never misses a voxel of the range.
    """
    cdef Range r
    cdef int k
    if box_empty(b):
        return False
    for k in range(3):
        r.lo[k] = roughly(g, k, b.lo[k], -g.slack[k])
        r.hi[k] = roughly(g, k, b.hi[k], g.slack[k])
    return rays_within(&r, v)


cdef inline bint rays_within(const Range* r, VoxelRays v) noexcept nogil:
    """Whether any voxel of a range holds a ray."""
    cdef Range upper = uppers_of(v, r)
    cdef int k, x, y, z, side = 0
    for k in range(3):
        side = max(side, upper.hi[k] - upper.lo[k])
    if side > FEW:
        return v.any_within(r)
    for z in range(upper.lo[2] >> BRICK_BITS, (upper.hi[2] >> BRICK_BITS) + 1):
        for y in range(upper.lo[1] >> BRICK_BITS, (upper.hi[1] >> BRICK_BITS) + 1):
            for x in range(upper.lo[0] >> BRICK_BITS, (upper.hi[0] >> BRICK_BITS) + 1):
                if brick_within(v, r, &upper, x, y, z):
                    return True
    return False
