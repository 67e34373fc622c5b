"""Rays stored in voxels: candidates sorted by voxel, and which parts of space have any.

::

    entry    voxel (30 bits) | ray (21) | face (3)      bit 63: in its place
    start    where each voxel's entries begin; the last is the number of entries
    bricks   a word for each cube of 4 x 4 x 4 voxels, a bit a voxel: 1 where a ray is
    upper    level by level, a byte for each cube of 16, 64 ... voxels a side: 1 where a ray is
"""

from libc.stdint cimport int64_t, uint8_t, uint32_t, uint64_t

from bfrt.records cimport FACE_BITS, RAY_BITS

cdef enum:
    LEVELS = 8
    BRICK_BITS = 2


cdef class VoxelRays:
    cdef uint64_t[::1] entries
    cdef uint32_t[::1] start
    cdef uint64_t[::1] bricks
    cdef uint8_t[::1] upper
    cdef int64_t level_begin[LEVELS]   # of level 2, 3, ... in upper
    cdef int level_size[LEVELS][3]
    cdef int levels
    cdef int n[3]

    cdef int64_t voxels
    cdef int bucket_bits               # of a voxel's number below its bucket's
    cdef int64_t border[257]           # where each bucket's candidates begin

    cdef int64_t pack(self, const int64_t[::1] firsts, const int64_t[::1] counts) noexcept
    cdef void partition(self, int64_t n) noexcept
    cdef int bucket_of(self, uint64_t entry) noexcept nogil
    cdef void sort_buckets(self, int first, int last) noexcept
    cdef void count(self, int64_t voxel, int64_t end, int64_t first, int64_t last) noexcept nogil
    cdef void place(self, int64_t first, int64_t last) noexcept nogil
    cdef void sum_up(self, int first, int last) noexcept
    cdef void sum_up_row(self, int64_t row, int64_t brick, int bit) noexcept nogil
    cdef void raise_levels(self) noexcept
    cdef void raise_brick(self, int x, int y, int z) noexcept nogil
    cdef bint any_within(self, const int* lo, const int* hi) noexcept nogil
    cdef bint cube_within(self, int level, const int* cube, const int* lo,
                          const int* hi) noexcept nogil


cdef inline uint64_t entry_of(uint32_t voxel, uint32_t ray, int face) noexcept nogil:
    return <uint64_t>voxel << (RAY_BITS + FACE_BITS) | <uint64_t>ray << FACE_BITS | face


cdef inline uint32_t entry_voxel(uint64_t entry) noexcept nogil:
    return <uint32_t>(entry >> (RAY_BITS + FACE_BITS)) & 0x3FFFFFFF


cdef inline uint32_t entry_ray(uint64_t entry) noexcept nogil:
    return <uint32_t>(entry >> FACE_BITS) & ((1 << RAY_BITS) - 1)


cdef inline int entry_face(uint64_t entry) noexcept nogil:
    return entry & ((1 << FACE_BITS) - 1)


cdef inline uint64_t brick_word(VoxelRays v, int x, int y, int z) noexcept nogil:
    """Which voxels of a brick hold rays: bit x + 4 y + 16 z."""
    return v.bricks[x + v.level_size[1][0] * (y + v.level_size[1][1] * <int64_t>z)]


cdef inline bint occupied(VoxelRays v, int level, int x, int y, int z) noexcept nogil:
    """Whether a cube of a level above the first holds any ray."""
    cdef int* size = &v.level_size[level][0]
    return v.upper[v.level_begin[level] + x + size[0] * (y + size[1] * <int64_t>z)]


cdef inline int run(int lo, int hi, int brick) noexcept nogil:
    """Bits lo to hi of an axis, as far as they are in a brick."""
    lo -= brick << BRICK_BITS
    hi -= brick << BRICK_BITS
    lo = lo if lo > 0 else 0
    hi = hi if hi < 3 else 3
    return (2 << hi) - (1 << lo)


cdef inline uint64_t spread(int bits, int apart) noexcept nogil:
    """Four bits, moved apart."""
    return (
        <uint64_t>(bits & 1) | <uint64_t>(bits >> 1 & 1) << apart
        | <uint64_t>(bits >> 2 & 1) << 2 * apart | <uint64_t>(bits >> 3 & 1) << 3 * apart
    )


cdef inline uint64_t range_word(const int* lo, const int* hi, int x, int y,
                                int z) noexcept nogil:
    """The voxels lo to hi, inclusive, in brick (x, y, z), which holds some of them."""
    return (
        <uint64_t>run(lo[0], hi[0], x) * spread(run(lo[1], hi[1], y), 4)
        * spread(run(lo[2], hi[2], z), 16)
    )


cdef inline int covering_level(VoxelRays v, const int* lo, const int* hi) noexcept nogil:
    """The finest level of which few cubes cover the voxels lo to hi."""
    cdef int level = 1
    cdef int k, side = 0
    for k in range(3):
        side = max(side, hi[k] - lo[k])
    while level < v.levels and side >> (BRICK_BITS * level) > 1:
        level += 1
    return level
