"""Which rays wait where boxes are: none, by which most boxes, and most parents, are passed over; a
few, which are gathered; or many."""

from libc.stdint cimport int64_t, uint8_t, uint32_t, uint64_t

from bfrt.geometry.box cimport Box, box_empty
from bfrt.geometry.grid cimport Grid, Range, roughly
from bfrt.phases.voxel_rays cimport (
    BRICK_BITS, CROWD, VoxelRays, block_of, brick_within, brick_word, cube_word, entry_face,
    entry_ray, longest, lower_of, lowest_bit, upper_at, uppers_of,
)

cdef enum:
    FEW = 12  # upper voxels a side of which the bricks are looked at one by one
    MOST_NEAR = 64  # few rays; no more than wait for an object at once

# Entries of a few voxels: of each where it is, by which face it came there, and its ray.
cdef struct Near:
    int n
    bint full     # there are more
    int at[MOST_NEAR][3]
    uint8_t face[MOST_NEAR]
    uint32_t ray[MOST_NEAR]


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
    cdef int x, y, z
    if longest(&upper) > FEW:
        return v.any_within(r)
    for z in range(upper.lo[2] >> BRICK_BITS, (upper.hi[2] >> BRICK_BITS) + 1):
        for y in range(upper.lo[1] >> BRICK_BITS, (upper.hi[1] >> BRICK_BITS) + 1):
            for x in range(upper.lo[0] >> BRICK_BITS, (upper.hi[0] >> BRICK_BITS) + 1):
                if brick_within(v, r, &upper, x, y, z):
                    return True
    return False


cdef inline void entries_within(const Range* r, VoxelRays v, Near* near) noexcept nogil:
    """Gather the entries of all voxels of a range, unless they are many."""
    cdef Range upper = uppers_of(v, r)
    cdef int x, y, z
    near.n, near.full = 0, False
    if longest(&upper) > FEW:
        near.full = v.any_within(r)
        return
    for z in range(upper.lo[2] >> BRICK_BITS, (upper.hi[2] >> BRICK_BITS) + 1):
        for y in range(upper.lo[1] >> BRICK_BITS, (upper.hi[1] >> BRICK_BITS) + 1):
            for x in range(upper.lo[0] >> BRICK_BITS, (upper.hi[0] >> BRICK_BITS) + 1):
                gather_brick(r, &upper, v, x, y, z, near)
                if near.full:
                    return


cdef inline void gather_brick(const Range* r, const Range* upper, VoxelRays v, int x, int y, int z,
                              Near* near) noexcept nogil:
    """The entries of a brick's part of the range."""
    cdef uint64_t word = brick_word(v, x, y, z)
    cdef int bit
    if not word:
        return
    word &= cube_word(upper, x, y, z, BRICK_BITS)
    while word and not near.full:
        bit = lowest_bit(word)
        word &= word - 1
        gather_upper(
            r, v, x << BRICK_BITS | (bit & 3), y << BRICK_BITS | (bit >> 2 & 3),
            z << BRICK_BITS | bit >> 4, near,
        )


cdef inline void gather_upper(const Range* r, VoxelRays v, int x, int y, int z,
                              Near* near) noexcept nogil:
    """The entries of an upper voxel's part of the range."""
    cdef int64_t upper = upper_at(v, x, y, z)
    cdef int64_t i, block, first = v.start[upper], last = v.start[upper + 1]
    cdef uint64_t word
    cdef int lower
    if v.bits == 0:
        gather(v, first, last, 0, x, y, z, near)
        return
    word = cube_word(r, x, y, z, v.bits)
    block = block_of(v, upper) if last - first >= CROWD else -1
    if block >= 0:
        word &= v.block_word[block]
        while word and not near.full:
            lower = lowest_bit(word)
            word &= word - 1
            i = block << 3 * v.bits | lower
            gather(
                v, v.block_start[i], last if lower + 1 == 1 << 3 * v.bits else v.block_start[i + 1],
                lower, x, y, z, near,
            )
        return
    for i in range(first, last):
        lower = lower_of(v, v.entries[i])
        if word >> lower & 1:
            gather(v, i, i + 1, lower, x, y, z, near)


cdef inline void gather(VoxelRays v, int64_t first, int64_t last, int lower, int x, int y, int z,
                        Near* near) noexcept nogil:
    """The entries [first, last), all of one voxel: a place in the upper voxel (x, y, z)."""
    cdef int64_t i
    cdef int b = v.bits, mask = (1 << v.bits) - 1
    near.full = near.full or near.n + last - first > MOST_NEAR
    if near.full:
        return
    for i in range(first, last):
        near.at[near.n][0] = x << b | (lower & mask)
        near.at[near.n][1] = y << b | (lower >> b & mask)
        near.at[near.n][2] = z << b | lower >> 2 * b
        near.face[near.n] = <uint8_t>entry_face(v.entries[i])
        near.ray[near.n] = entry_ray(v.entries[i])
        near.n += 1
