"""The voxel ray store, on one level: candidates sorted by voxel, in place.

First into buckets of neighboring voxels, then, bucket by bucket, into voxels: a counting sort over
the whole grid would miss the cache with every candidate (it took five times as long).
"""

cimport cython
from libc.stdint cimport int64_t, uint32_t, uint64_t
from libc.string cimport memmove, memset

import numpy as np

cdef enum:
    PLACED_BIT = 63
    BUCKETS = 256  # parts of the grid whose voxels and candidates fit a core's cache


@cython.final
cdef class VoxelRays:
    """Candidates of one pass, by voxel.

    Parameters
    ----------
    shape : tuple of 3 int
        Voxels an axis.
    capacity : int
        Candidates at the most. All memory is taken here.
    """

    def __cinit__(self, shape, int64_t capacity):
        cdef int64_t upper = 0
        cdef int k
        size = np.array(shape, np.int64)
        for k in range(3):
            self.n[k] = size[k]
        self.levels = 0
        while self.levels == 0 or (size.max() > 1 and self.levels < LEVELS - 1):
            size = (size + (1 << BRICK_BITS) - 1) >> BRICK_BITS
            self.levels += 1
            for k in range(3):
                self.level_size[self.levels][k] = size[k]
            if self.levels == 1:
                self.bricks = np.empty(np.prod(size), np.uint64)
            else:
                self.level_begin[self.levels] = upper
                upper += np.prod(size)
        self.entries = np.empty(capacity, np.uint64)
        self.voxels = int(np.prod(shape))
        self.start = np.empty(self.voxels + 1, np.uint32)
        self.upper = np.empty(upper, np.uint8)
        self.bucket_bits = 0
        while (self.voxels - 1) >> self.bucket_bits >= BUCKETS:
            self.bucket_bits += 1

    @property
    def slots(self):
        """Where candidates are put before `sort`, (capacity,) uint64."""
        return np.asarray(self.entries)

    def sort(self, const int64_t[::1] firsts, const int64_t[::1] counts, workers):
        """Put candidates into their voxels.

        Parameters
        ----------
        firsts, counts : (segments,) int64
            Where in `slots` they are, ascending.
        workers : bfrt.workers.Workers
            Each sorts the candidates of some buckets, each part of the grid small enough for
            its core's cache, and sums up some layers of bricks.
        """
        cdef int64_t n = self.pack(firsts, counts)

        def buckets(_, first, last):
            self.sort_buckets(first, last)

        def layers(_, first, last):
            self.sum_up(first, last)

        self.partition(n)
        workers.run(buckets, BUCKETS)
        self.start[self.voxels] = <uint32_t>n
        workers.run(layers, self.level_size[1][2])
        self.raise_levels()

    cdef int64_t pack(self, const int64_t[::1] firsts, const int64_t[::1] counts) noexcept:
        """Close the gaps between the segments; returns how many candidates there are."""
        cdef int64_t n = 0, i
        with nogil:
            for i in range(firsts.shape[0]):
                memmove(&self.entries[n], &self.entries[firsts[i]], counts[i] * sizeof(uint64_t))
                n += counts[i]
        return n

    cdef void partition(self, int64_t n) noexcept:
        """Bring candidates into the order of their buckets, and note where each begins.

        An American flag sort (McIlroy, Bostic and McIlroy 1993): counts, then swaps into place.
        """
        cdef int64_t next_of[BUCKETS]
        cdef int64_t i
        cdef int b, own
        cdef uint64_t entry, other
        with nogil:
            memset(&self.border[0], 0, sizeof(self.border))
            for i in range(n):
                self.border[self.bucket_of(self.entries[i]) + 1] += 1
            for b in range(BUCKETS):
                next_of[b] = self.border[b]
                self.border[b + 1] += self.border[b]
            for b in range(BUCKETS):
                while next_of[b] < self.border[b + 1]:
                    entry = self.entries[next_of[b]]
                    own = self.bucket_of(entry)
                    while own != b:
                        other = self.entries[next_of[own]]
                        self.entries[next_of[own]] = entry
                        next_of[own] += 1
                        entry = other
                        own = self.bucket_of(entry)
                    self.entries[next_of[b]] = entry
                    next_of[b] += 1

    cdef inline int bucket_of(self, uint64_t entry) noexcept nogil:
        return <int>(entry_voxel(entry) >> self.bucket_bits)

    cdef void sort_buckets(self, int first, int last) noexcept:
        """Sort the candidates of buckets [first, last)."""
        cdef int b
        cdef int64_t voxel
        with nogil:
            for b in range(first, last):
                voxel = min(<int64_t>b << self.bucket_bits, self.voxels)
                self.count(
                    voxel, min(<int64_t>(b + 1) << self.bucket_bits, self.voxels),
                    self.border[b], self.border[b + 1],
                )
                self.place(self.border[b], self.border[b + 1])

    cdef void count(self, int64_t voxel, int64_t end, int64_t first,
                    int64_t last) noexcept nogil:
        """Set start[v] to where voxel v's entries end, for v in [voxel, end)."""
        cdef int64_t i
        cdef uint32_t total = <uint32_t>first
        self.start[voxel:end] = 0
        for i in range(first, last):
            self.start[entry_voxel(self.entries[i])] += 1
        for i in range(voxel, end):
            total += self.start[i]
            self.start[i] = total

    cdef void place(self, int64_t first, int64_t last) noexcept nogil:
        """Follow each cycle of the permutation; start[v] sinks to where v begins."""
        cdef uint64_t placed = <uint64_t>1 << PLACED_BIT
        cdef uint64_t entry, other
        cdef int64_t i, j
        cdef uint32_t voxel
        for i in range(first, last):
            entry = self.entries[i]
            while not entry & placed:
                voxel = entry_voxel(entry)
                self.start[voxel] -= 1
                j = self.start[voxel]
                other = self.entries[j]
                self.entries[j] = entry | placed
                if j == i:
                    break
                entry = other

    cdef void sum_up(self, int first, int last) noexcept:
        """Set the bits of voxels that hold rays, in the layers [first, last) of bricks."""
        cdef int z, y
        cdef int64_t row, brick
        cdef int64_t layer = self.level_size[1][0] * <int64_t>self.level_size[1][1]
        with nogil:
            self.bricks[first * layer:last * layer] = 0
            for z in range(first << BRICK_BITS, min(last << BRICK_BITS, self.n[2])):
                for y in range(self.n[1]):
                    row = self.n[0] * (y + self.n[1] * <int64_t>z)
                    # Most rows are empty: their last entry ends where their first begins.
                    if self.start[row] != self.start[row + self.n[0]]:
                        brick = layer * (z >> BRICK_BITS) + self.level_size[1][0] * (
                            <int64_t>y >> BRICK_BITS
                        )
                        self.sum_up_row(row, brick, (y & 3) << 2 | (z & 3) << 4)

    cdef void sum_up_row(self, int64_t row, int64_t brick, int bit) noexcept nogil:
        """Set the bits, from `bit` on in each brick, of one row of voxels."""
        cdef int x
        for x in range(self.n[0]):
            if self.start[row + x] != self.start[row + x + 1]:
                self.bricks[brick + (x >> BRICK_BITS)] |= <uint64_t>1 << (bit | x & 3)

    cdef void raise_levels(self) noexcept:
        """Mark every cube above a brick that holds rays, up to the first that is marked."""
        cdef int x, y, z
        cdef int64_t at = 0
        with nogil:
            self.upper[:] = 0
            for z in range(self.level_size[1][2]):
                for y in range(self.level_size[1][1]):
                    for x in range(self.level_size[1][0]):
                        if self.bricks[at]:
                            self.raise_brick(x, y, z)
                        at += 1

    cdef void raise_brick(self, int x, int y, int z) noexcept nogil:
        cdef int level
        cdef int64_t at
        for level in range(2, self.levels + 1):
            x >>= BRICK_BITS
            y >>= BRICK_BITS
            z >>= BRICK_BITS
            at = self.level_begin[level] + x + self.level_size[level][0] * (
                y + self.level_size[level][1] * <int64_t>z
            )
            if self.upper[at]:
                return
            self.upper[at] = 1

    cdef bint any_within(self, const int* lo, const int* hi) noexcept nogil:
        """Whether any of the voxels lo to hi, inclusive, holds a ray."""
        cdef int cube[3]
        cdef int level = covering_level(self, lo, hi)
        for cube[2] in range(lo[2] >> BRICK_BITS * level, (hi[2] >> BRICK_BITS * level) + 1):
            for cube[1] in range(lo[1] >> BRICK_BITS * level, (hi[1] >> BRICK_BITS * level) + 1):
                for cube[0] in range(
                    lo[0] >> BRICK_BITS * level, (hi[0] >> BRICK_BITS * level) + 1
                ):
                    if self.cube_within(level, &cube[0], lo, hi):
                        return True
        return False

    cdef bint cube_within(self, int level, const int* cube, const int* lo,
                          const int* hi) noexcept nogil:
        """The same of the part of them that a cube of some level holds."""
        cdef uint64_t word
        cdef int first[3]
        cdef int last[3]
        cdef int part[3]
        cdef int k, below = BRICK_BITS * (level - 1)
        if level == 1:
            word = brick_word(self, cube[0], cube[1], cube[2])
            return word and word & range_word(lo, hi, cube[0], cube[1], cube[2])
        if not occupied(self, level, cube[0], cube[1], cube[2]):
            return False
        for k in range(3):
            first[k] = max(cube[k] << BRICK_BITS, lo[k] >> below)
            last[k] = min((cube[k] << BRICK_BITS) + (1 << BRICK_BITS) - 1, hi[k] >> below)
        for part[2] in range(first[2], last[2] + 1):
            for part[1] in range(first[1], last[1] + 1):
                for part[0] in range(first[0], last[0] + 1):
                    if self.cube_within(level - 1, &part[0], lo, hi):
                        return True
        return False
