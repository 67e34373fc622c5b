"""Rays stored in voxels: candidates sorted by voxel, and which parts of space have any.

::

    entry    voxel (30 bits) | ray (21) | face (3)      bit 63: in its place
    start    where each voxel's entries begin; the last is the number of entries
    bricks   level by level, one byte a cube of 4, 16, 64 ... voxels a side: 1 where a ray is
"""

from libc.stdint cimport int64_t, uint8_t, uint32_t, uint64_t

from bfrt.records cimport FACE_BITS, RAY_BITS

cdef enum:
    LEVELS = 8
    BRICK_BITS = 2


cdef class VoxelRays:
    cdef uint64_t[::1] entries
    cdef uint32_t[::1] start
    cdef uint8_t[::1] bricks
    cdef int64_t level_begin[LEVELS]   # of level 1, 2, ... at 1, 2, ...
    cdef int level_size[LEVELS][3]
    cdef int levels
    cdef int n[3]

    cdef void count(self, int64_t n) noexcept nogil
    cdef void occupy(self, uint32_t voxel) noexcept nogil
    cdef void place(self, int64_t n) noexcept nogil


cdef inline uint64_t entry_of(uint32_t voxel, uint32_t ray, int face) noexcept nogil:
    return <uint64_t>voxel << (RAY_BITS + FACE_BITS) | <uint64_t>ray << FACE_BITS | face


cdef inline uint32_t entry_voxel(uint64_t entry) noexcept nogil:
    return <uint32_t>(entry >> (RAY_BITS + FACE_BITS)) & 0x3FFFFFFF


cdef inline uint32_t entry_ray(uint64_t entry) noexcept nogil:
    return <uint32_t>(entry >> FACE_BITS) & ((1 << RAY_BITS) - 1)


cdef inline int entry_face(uint64_t entry) noexcept nogil:
    return entry & ((1 << FACE_BITS) - 1)


cdef inline bint occupied(VoxelRays v, int level, int x, int y, int z) noexcept nogil:
    """Whether a brick of a level holds any ray."""
    cdef int* size = &v.level_size[level][0]
    return v.bricks[v.level_begin[level] + x + size[0] * (y + size[1] * <int64_t>z)]
