"""Which rays wait where boxes are: whether any does, by which most boxes, and most parents, are
passed over; and which, gathered a few at a time."""

from libc.stdint cimport int64_t, uint8_t, uint32_t, uint64_t

from bfrt.bits cimport lowest_bit
from bfrt.geometry.box cimport Box, box_empty
from bfrt.grid.planes cimport Planes, Range, rough_range
from bfrt.geometry.lanes cimport LANES
from bfrt.grid.voxel_rays cimport (
    BRICK_BITS, CROWD, VoxelRays, block_of, brick_within, brick_word, covering_level, cube_word,
    entry_face, entry_ray, longest, lower_of, occupied, upper_at, uppers_of,
)

cdef enum:
    FEW = 12  # upper voxels a side of which the bricks are looked at one by one

# Called with its context when there is no room for more entries, to make some.
ctypedef int (*Spill)(void*) except -1 nogil

# The entries of a region's voxels, no more than there are lanes: of each where it is, by which face
# it came there, and its ray.
cdef struct Near:
    Spill spill   # or NULL: no more are looked for than there is room for
    void* context
    const Range* region
    Range uppers  # the region's upper voxels
    int n
    bint more     # than that
    int at[LANES][3]
    uint8_t face[LANES]
    uint32_t ray[LANES]


cdef inline bint rays_near(VoxelRays v, const Planes* g, const Box* b) noexcept nogil:
    """Tell whether any voxel that a box may touch holds a ray.

    Arithmetic with some slack, in place of the table: it never misses a voxel of the range.
    """
    cdef Range r
    if box_empty(b):
        return False
    r = rough_range(g, b)
    return rays_within(v, &r)


cdef inline bint rays_within(VoxelRays v, const Range* r) noexcept nogil:
    """Tell whether any voxel of a range holds a ray."""
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


cdef inline int entries_within(VoxelRays v, const Range* region, Near* near) except -1 nogil:
    """Gather the entries of all voxels of a region, cube by cube of few that cover it."""
    cdef Range* uppers = &near.uppers
    cdef int level, down, x, y, z
    near.region, uppers[0] = region, uppers_of(v, region)
    near.n, near.more = 0, False
    level = covering_level(v, uppers)
    down = BRICK_BITS * level
    for z in range(uppers.lo[2] >> down, (uppers.hi[2] >> down) + 1):
        for y in range(uppers.lo[1] >> down, (uppers.hi[1] >> down) + 1):
            for x in range(uppers.lo[0] >> down, (uppers.hi[0] >> down) + 1):
                gather_cube(v, near, level, x, y, z)
                if near.more:
                    return 0
    return 0


cdef inline int gather_cube(VoxelRays v, Near* near, int level, int cx, int cy,
                            int cz) except -1 nogil:
    """Gather the region's entries that are in a cube."""
    cdef const Range* uppers = &near.uppers
    cdef int at[3]
    cdef Range part
    cdef int k, x, y, z, below
    if level == 1:
        return gather_brick(v, near, cx, cy, cz)
    if not occupied(v, level, cx, cy, cz):
        return 0
    at[0], at[1], at[2] = cx, cy, cz
    below = BRICK_BITS * (level - 1)
    for k in range(3):
        part.lo[k] = max(at[k] << BRICK_BITS, uppers.lo[k] >> below)
        part.hi[k] = min((at[k] << BRICK_BITS) + (1 << BRICK_BITS) - 1, uppers.hi[k] >> below)
    for z in range(part.lo[2], part.hi[2] + 1):
        for y in range(part.lo[1], part.hi[1] + 1):
            for x in range(part.lo[0], part.hi[0] + 1):
                gather_cube(v, near, level - 1, x, y, z)
                if near.more:
                    return 0
    return 0


cdef inline int gather_brick(VoxelRays v, Near* near, int x, int y, int z) except -1 nogil:
    """Gather the region's entries that are in a brick."""
    cdef uint64_t word = brick_word(v, x, y, z)
    cdef int bit
    if not word:
        return 0
    word &= cube_word(&near.uppers, x, y, z, BRICK_BITS)
    while word and not near.more:
        bit = lowest_bit(word)
        word &= word - 1
        gather_upper(
            v, near, x << BRICK_BITS | (bit & 3), y << BRICK_BITS | (bit >> 2 & 3),
            z << BRICK_BITS | bit >> 4,
        )
    return 0


cdef inline int gather_upper(VoxelRays v, Near* near, int x, int y, int z) except -1 nogil:
    """Gather the region's entries that are in an upper voxel."""
    cdef int64_t upper = upper_at(v, x, y, z)
    cdef int64_t i, block, first = v.start[upper], last = v.start[upper + 1]
    cdef int b = v.bits
    cdef int corner[3]
    cdef uint64_t word
    cdef int lower
    corner[0], corner[1], corner[2] = x << b, y << b, z << b
    if b == 0:
        return gather(v, near, first, last, &corner[0], 0)
    word = cube_word(near.region, x, y, z, b)
    block = block_of(v, upper) if last - first >= CROWD else -1
    if block >= 0:
        word &= v.block_word[block]
        while word and not near.more:
            lower = lowest_bit(word)
            word &= word - 1
            i = block << 3 * b | lower
            gather(
                v, near, v.block_start[i],
                last if lower + 1 == 1 << 3 * b else v.block_start[i + 1], &corner[0], lower,
            )
        return 0
    for i in range(first, last):
        lower = lower_of(v, v.entries[i])
        if word >> lower & 1:
            gather(v, near, i, i + 1, &corner[0], lower)
            if near.more:
                return 0
    return 0


cdef inline int gather(VoxelRays v, Near* near, int64_t first, int64_t last, const int* corner,
                       int lower) except -1 nogil:
    """Gather the entries [first, last), all of one voxel: `lower` of the upper voxel that begins at
    `corner`."""
    cdef int64_t i
    cdef int b = v.bits, mask = (1 << v.bits) - 1
    for i in range(first, last):
        if near.n == LANES:
            if near.spill == NULL:
                near.more = True
                return 0
            near.spill(near.context)
        near.at[near.n][0] = corner[0] | (lower & mask)
        near.at[near.n][1] = corner[1] | (lower >> b & mask)
        near.at[near.n][2] = corner[2] | lower >> 2 * b
        near.face[near.n] = <uint8_t>entry_face(v.entries[i])
        near.ray[near.n] = entry_ray(v.entries[i])
        near.n += 1
    return 0
