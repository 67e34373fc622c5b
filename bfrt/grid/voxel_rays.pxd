"""Rays stored in voxels on two levels: candidates sorted by upper voxel, and which parts of space
have any (the paper's section 3.2, figure 5).

::

    entry    voxel (30 bits) | ray (21) | face (3)      bit 63: in its place
             voxel: upper voxel << 3 bits | where in it: x | y << bits | z << 2 bits
    start    where each upper voxel's entries begin; the last is the number of entries
    bricks   a word for each cube of 4 x 4 x 4 upper voxels, a bit each: 1 where a ray is
    cubes    level by level, a byte for each cube of 16, 64 ... upper voxels a side
    block    an upper voxel's lower level: a bit for each of its voxels, and where its entries begin
    places   which upper voxel has which block, a hash table: (upper voxel + 1) << 24 | block

With bits = 0 an upper voxel is a voxel, and nothing has a block.
"""

from libc.stdint cimport int64_t, uint8_t, uint32_t, uint64_t

from bfrt.bits cimport lowest_bit
from bfrt.grid.planes cimport Range
from bfrt.records cimport FACE_BITS, RAY_BITS, VOXEL_BITS

cdef enum:
    LEVELS = 8
    BRICK_BITS = 2
    BUCKETS = 256    # parts of the grid whose voxels and candidates fit a core's cache
    BLOCK_BITS = 24
    CROWD = 12       # the fewest rays of an upper voxel that are worth a block


cdef class VoxelRays:
    cdef int bits                      # an upper voxel is 2^bits voxels a side
    cdef int n[3]                      # upper voxels an axis
    cdef int64_t uppers
    cdef uint64_t[::1] entries
    cdef uint32_t[::1] start
    cdef uint64_t[::1] bricks
    cdef uint8_t[::1] cubes
    cdef int64_t level_begin[LEVELS]   # of level 2, 3, ... in cubes
    cdef int level_size[LEVELS][3]
    cdef int levels
    cdef int bucket_bits               # of an upper voxel's number below its bucket's
    cdef int64_t border[257]           # where each bucket's candidates begin
    cdef readonly int64_t blocks       # that there are, and that are given away
    cdef readonly int64_t given
    cdef uint32_t[::1] owner           # the upper voxel that has a block
    cdef uint64_t[::1] block_word
    cdef uint32_t[::1] block_start
    cdef uint64_t[::1] places
    cdef int place_bits

    cdef void partition(self, int64_t n) noexcept
    cdef void sort_buckets(self, int first, int last) noexcept
    cdef void count(self, int64_t upper, int64_t end, int64_t first, int64_t last) noexcept nogil
    cdef void place(self, int64_t first, int64_t last) noexcept nogil
    cdef void sum_up(self, int first, int last) noexcept
    cdef void sum_up_row(self, int64_t row, int64_t brick, int bit) noexcept nogil
    cdef void raise_levels(self) noexcept
    cdef void raise_brick(self, int x, int y, int z) noexcept nogil
    cdef void give_blocks(self) noexcept
    cdef void visit(self, int64_t* histogram, int64_t least, int64_t left) noexcept nogil
    cdef void give(self, uint32_t upper) noexcept nogil
    cdef void fill_blocks(self, int64_t first, int64_t last) noexcept
    cdef void fill(self, int64_t block) noexcept nogil
    cdef bint any_within(self, const Range* r) noexcept nogil
    cdef bint cube_within(self, int level, const int* cube, const Range* r,
                          const Range* upper) noexcept nogil


cdef inline uint64_t entry_of(uint32_t voxel, uint32_t ray, int face) noexcept nogil:
    return <uint64_t>voxel << (RAY_BITS + FACE_BITS) | <uint64_t>ray << FACE_BITS | face


cdef inline uint32_t entry_voxel(uint64_t entry) noexcept nogil:
    return <uint32_t>(entry >> (RAY_BITS + FACE_BITS)) & ((1 << VOXEL_BITS) - 1)


cdef inline uint32_t entry_ray(uint64_t entry) noexcept nogil:
    return <uint32_t>(entry >> FACE_BITS) & ((1 << RAY_BITS) - 1)


cdef inline int entry_face(uint64_t entry) noexcept nogil:
    return entry & ((1 << FACE_BITS) - 1)


cdef inline uint32_t voxel_of(VoxelRays v, const int* at) noexcept nogil:
    """Return the number of a voxel in entries: its upper voxel's, then its place in that."""
    cdef int b = v.bits, mask = (1 << v.bits) - 1
    cdef uint32_t upper = <uint32_t>((at[0] >> b) + v.n[0] * ((at[1] >> b) + v.n[1] * (at[2] >> b)))
    return upper << 3 * b | (at[0] & mask) | (at[1] & mask) << b | (at[2] & mask) << 2 * b


cdef inline int lower_of(VoxelRays v, uint64_t entry) noexcept nogil:
    """Return the place of an entry's voxel in its upper voxel."""
    return <int>(entry_voxel(entry) & ((1 << 3 * v.bits) - 1))


cdef inline int64_t upper_at(VoxelRays v, int x, int y, int z) noexcept nogil:
    """Return the number of an upper voxel."""
    return x + v.n[0] * (y + v.n[1] * <int64_t>z)


cdef inline Range uppers_of(VoxelRays v, const Range* r) noexcept nogil:
    """Return the upper voxels that contain some of the voxels of a range."""
    cdef Range upper
    cdef int k
    for k in range(3):
        upper.lo[k] = r.lo[k] >> v.bits
        upper.hi[k] = r.hi[k] >> v.bits
    return upper


cdef inline uint64_t brick_word(VoxelRays v, int x, int y, int z) noexcept nogil:
    """Return as bits x + 4 y + 16 z which upper voxels of a brick hold rays."""
    return v.bricks[x + v.level_size[1][0] * (y + v.level_size[1][1] * <int64_t>z)]


cdef inline bint occupied(VoxelRays v, int level, int x, int y, int z) noexcept nogil:
    """Tell whether a cube of a level above the first holds any ray."""
    cdef int* size = &v.level_size[level][0]
    return v.cubes[v.level_begin[level] + x + size[0] * (y + size[1] * <int64_t>z)]


cdef inline int run(int lo, int hi, int cube, int bits) noexcept nogil:
    """Return lo to hi of an axis as bits, cut to a cube of 2^bits a side."""
    cdef int last = (1 << bits) - 1
    lo -= cube << bits
    hi -= cube << bits
    lo = lo if lo > 0 else 0
    hi = hi if hi < last else last
    return (2 << hi) - (1 << lo)


cdef inline uint64_t spread(int bits, int apart) noexcept nogil:
    """Return four bits, moved apart."""
    return (
        <uint64_t>(bits & 1) | <uint64_t>(bits >> 1 & 1) << apart
        | <uint64_t>(bits >> 2 & 1) << 2 * apart | <uint64_t>(bits >> 3 & 1) << 3 * apart
    )


cdef inline uint64_t cube_word(const Range* r, int x, int y, int z, int bits) noexcept nogil:
    """Return as bits the voxels of a range in cube (x, y, z) of 2^bits a side; there are some."""
    return (
        <uint64_t>run(r.lo[0], r.hi[0], x, bits) * spread(run(r.lo[1], r.hi[1], y, bits), 1 << bits)
        * spread(run(r.lo[2], r.hi[2], z, bits), 1 << 2 * bits)
    )


cdef inline int64_t block_of(VoxelRays v, int64_t upper) noexcept nogil:
    """Return the block of an upper voxel with a crowd of rays, or -1."""
    cdef uint64_t mask = (<uint64_t>1 << v.place_bits) - 1
    cdef uint64_t at = place_of(v, <uint32_t>upper)
    while v.places[at]:
        if v.places[at] >> BLOCK_BITS == <uint64_t>upper + 1:
            return <int64_t>(v.places[at] & ((1 << BLOCK_BITS) - 1))
        at = (at + 1) & mask
    return -1


cdef inline uint64_t place_of(VoxelRays v, uint32_t upper) noexcept nogil:
    """Return where to look first in the hash table: Fibonacci hashing (Knuth, volume 3, 6.4)."""
    return upper * <uint64_t>0x9E3779B97F4A7C15 >> (64 - v.place_bits)


cdef inline bint upper_within(VoxelRays v, const Range* r, int x, int y, int z) noexcept nogil:
    """Tell whether an upper voxel that holds rays has one in a range that reaches into it."""
    cdef uint64_t word
    cdef int64_t upper, block, i
    if v.bits == 0:
        return True
    word = cube_word(r, x, y, z, v.bits)
    upper = upper_at(v, x, y, z)
    if v.start[upper + 1] - v.start[upper] >= CROWD:
        block = block_of(v, upper)
        if block >= 0:
            return (v.block_word[block] & word) != 0
    for i in range(v.start[upper], v.start[upper + 1]):
        if word >> lower_of(v, v.entries[i]) & 1:
            return True
    return False


cdef inline bint brick_within(VoxelRays v, const Range* r, const Range* upper, int x, int y,
                              int z) noexcept nogil:
    """Tell whether a brick of upper voxels has a ray in a range that reaches into it."""
    cdef uint64_t word = brick_word(v, x, y, z)
    cdef int bit
    if not word:
        return False
    word &= cube_word(upper, x, y, z, BRICK_BITS)
    while word:
        bit = lowest_bit(word)
        word &= word - 1
        if upper_within(v, r, x << BRICK_BITS | (bit & 3), y << BRICK_BITS | (bit >> 2 & 3),
                        z << BRICK_BITS | bit >> 4):
            return True
    return False


cdef inline int longest(const Range* upper) noexcept nogil:
    """Return a range's longest side, less one."""
    cdef int k, side = 0
    for k in range(3):
        side = max(side, upper.hi[k] - upper.lo[k])
    return side


cdef inline int covering_level(VoxelRays v, const Range* upper) noexcept nogil:
    """Return the finest level of which few cubes cover the upper voxels of a range."""
    cdef int level = 1, side = longest(upper)
    while level < v.levels and side >> (BRICK_BITS * level) > 1:
        level += 1
    return level
