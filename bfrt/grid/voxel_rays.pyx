"""The voxel ray store: candidates sorted by upper voxel, in place; crowds by voxel too.

First into buckets of neighboring voxels, then, bucket by bucket, into voxels: a counting sort over
the whole grid would miss the cache with every candidate (it took five times as long).
"""

cimport cython
from libc.stdint cimport int64_t, uint32_t, uint64_t
from libc.string cimport memset

import numpy as np

from bfrt.grid.planes cimport Range

from bfrt.workers import worth_handing

#: An upper voxel: where its rays begin, and a bit of the occupancy, with what is above that.
UPPER_BYTES = 4.0 + 1.0 / 8 + 1.0 / 32

#: A lower-level block: where the rays of 64 voxels begin, a bit for each, whose it is, and twice a
#: place in the table by which it is found.
BLOCK_BYTES = 4 * 64 + 8 + 4 + 2 * 8

cdef enum:
    PLACED_BIT = 63
    LONGEST = 1024  # runs of so many rays and more are equally long
    LOWER = 64      # voxels of an upper voxel at the most


cdef inline int key_of(uint64_t entry, int keys, int shift) noexcept nogil:
    """Return some bits of an entry's voxel; keys is a power of two."""
    return <int>(entry_voxel(entry) >> shift) & (keys - 1)


cdef void swap_into_place(uint64_t* entries, int64_t* next_of, const int64_t* end_of, int keys,
                          int shift) noexcept nogil:
    """Bring entries into the order of their keys, those of key k to [next_of[k], end_of[k])."""
    cdef uint64_t entry, other
    cdef int k, own
    for k in range(keys):
        while next_of[k] < end_of[k]:
            entry = entries[next_of[k]]
            own = key_of(entry, keys, shift)
            while own != k:
                other = entries[next_of[own]]
                entries[next_of[own]] = entry
                next_of[own] += 1
                entry = other
                own = key_of(entry, keys, shift)
            entries[next_of[k]] = entry
            next_of[k] += 1


@cython.final
cdef class VoxelRays:
    """Stores the candidates of one pass by their voxels.

    Parameters
    ----------
    shape : tuple of 3 int
        Voxels an axis.
    bits : int
        An upper voxel is 2^bits voxels a side: 0 for a grid of one level, 1 or 2.
    blocks : int
        Lower-level blocks. They go to the upper voxels with the most rays; in others, and in all
        that have but a few, rays are looked through one by one.
    """

    def __cinit__(self, shape, int bits=0, int64_t blocks=0):
        cdef int64_t upper = 0
        cdef int k
        self.bits = bits
        size = -(-np.array(shape, np.int64) >> bits)
        for k in range(3):
            self.n[k] = size[k]
        self.uppers = int(np.prod(size))
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
        self.start = np.empty(self.uppers + 1, np.uint32)
        self.cubes = np.empty(upper, np.uint8)
        self.bucket_bits = 0
        while (self.uppers - 1) >> self.bucket_bits >= BUCKETS:
            self.bucket_bits += 1
        self.blocks = min(blocks, self.uppers, (1 << BLOCK_BITS) - 1) if bits else 0
        self.owner = np.empty(self.blocks, np.uint32)
        self.block_word = np.empty(self.blocks, np.uint64)
        self.block_start = np.empty(self.blocks << 3 * bits, np.uint32)
        self.place_bits = 1
        while 1 << self.place_bits < 2 * self.blocks:
            self.place_bits += 1
        self.places = np.zeros(1 << self.place_bits, np.uint64)

    @staticmethod
    def bytes(uppers, blocks):
        """Return the bytes of a store with this many upper voxels and lower-level blocks."""
        return int(uppers * UPPER_BYTES + blocks * BLOCK_BYTES)

    def sort(self, uint64_t[::1] slots, int64_t n, workers):
        """Put candidates into their voxels.

        Parameters
        ----------
        slots : (n or more,) uint64
            IN, OUT. The candidates, which are sorted where they are, and stay there.
        workers : bfrt.workers.Workers
            Each sorts the candidates of some buckets, each part of the grid small enough for
            its core's cache, sums up some layers of bricks, and fills some blocks.
        """
        def buckets(_, first, last):
            self.sort_buckets(first, last)

        def layers(_, first, last):
            self.sum_up(first, last)

        def blocks(_, first, last):
            self.fill_blocks(first, last)

        self.entries = slots
        self.partition(n)
        workers.run(buckets, BUCKETS, smallest=min(BUCKETS, worth_handing(BUCKETS, n)))
        self.start[self.uppers] = <uint32_t>n
        workers.run(layers, self.level_size[1][2],
                    smallest=worth_handing(self.level_size[1][2], self.uppers))
        self.raise_levels()
        if self.blocks:
            self.give_blocks()
            workers.run(blocks, self.given, smallest=64)

    cdef void partition(self, int64_t n) noexcept:
        """Bring candidates into the order of their buckets, and note where each begins.

        An American flag sort (McIlroy, Bostic and McIlroy 1993): counts, then swaps into place.
        """
        cdef int64_t next_of[BUCKETS]
        cdef int64_t i
        cdef int b, shift = 3 * self.bits + self.bucket_bits
        with nogil:
            memset(&self.border[0], 0, sizeof(self.border))
            for i in range(n):
                self.border[key_of(self.entries[i], BUCKETS, shift) + 1] += 1
            for b in range(BUCKETS):
                next_of[b] = self.border[b]
                self.border[b + 1] += self.border[b]
            swap_into_place(
                &self.entries[0], &next_of[0], &self.border[1], BUCKETS, shift
            )

    cdef void sort_buckets(self, int first, int last) noexcept:
        """Sort the candidates of buckets [first, last)."""
        cdef int b
        cdef int64_t upper
        with nogil:
            for b in range(first, last):
                upper = min(<int64_t>b << self.bucket_bits, self.uppers)
                self.count(
                    upper, min(<int64_t>(b + 1) << self.bucket_bits, self.uppers),
                    self.border[b], self.border[b + 1],
                )
                self.place(self.border[b], self.border[b + 1])

    cdef void count(self, int64_t upper, int64_t end, int64_t first,
                    int64_t last) noexcept nogil:
        """Set start[u] to where upper voxel u's entries end, for u in [upper, end)."""
        cdef int64_t i
        cdef uint32_t total = <uint32_t>first
        self.start[upper:end] = 0
        for i in range(first, last):
            self.start[entry_voxel(self.entries[i]) >> 3 * self.bits] += 1
        for i in range(upper, end):
            total += self.start[i]
            self.start[i] = total

    cdef void place(self, int64_t first, int64_t last) noexcept nogil:
        """Follow each cycle of the permutation; start[u] sinks to where u begins."""
        cdef uint64_t placed = <uint64_t>1 << PLACED_BIT
        cdef uint64_t entry, other
        cdef int64_t i, j
        cdef uint32_t upper
        for i in range(first, last):
            entry = self.entries[i]
            while not entry & placed:
                upper = entry_voxel(entry) >> 3 * self.bits
                self.start[upper] -= 1
                j = self.start[upper]
                other = self.entries[j]
                self.entries[j] = entry | placed
                if j == i:
                    break
                entry = other

    cdef void sum_up(self, int first, int last) noexcept:
        """Set the bits of upper voxels that hold rays, in the layers [first, last) of bricks."""
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
        """Set the bits, from `bit` on in each brick, of one row of upper voxels."""
        cdef int x
        for x in range(self.n[0]):
            if self.start[row + x] != self.start[row + x + 1]:
                self.bricks[brick + (x >> BRICK_BITS)] |= <uint64_t>1 << (bit | x & 3)

    cdef void raise_levels(self) noexcept:
        """Mark every cube above a brick that holds rays, up to the first that is marked."""
        cdef int x, y, z
        cdef int64_t at = 0
        with nogil:
            self.cubes[:] = 0
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
            if self.cubes[at]:
                return
            self.cubes[at] = 1

    cdef void give_blocks(self) noexcept:
        """Give the blocks away: to the upper voxels with the most rays, if they have a crowd."""
        cdef int64_t histogram[LONGEST + 1]
        cdef int64_t left = self.blocks
        cdef int least = LONGEST
        with nogil:
            self.given = 0
            self.places[:] = 0
            memset(&histogram[0], 0, sizeof(histogram))
            self.visit(&histogram[0], 0, 0)
            while least > CROWD and histogram[least] <= left:
                left -= histogram[least]
                least -= 1
            # Of those with the least rays that still get one, the first do.
            self.visit(NULL, least, left)

    cdef void visit(self, int64_t* histogram, int64_t least, int64_t left) noexcept nogil:
        """Visit the upper voxels that hold rays: count how many have each number of rays, or give
        blocks to all with more rays than `least`, and to the first `left` with exactly as many.
        """
        cdef int x, y, z, bit
        cdef int64_t upper, rays, at = 0
        cdef uint64_t word
        for z in range(self.level_size[1][2]):
            for y in range(self.level_size[1][1]):
                for x in range(self.level_size[1][0]):
                    word = self.bricks[at]
                    at += 1
                    while word:
                        bit = lowest_bit(word)
                        word &= word - 1
                        upper = upper_at(
                            self, x << BRICK_BITS | (bit & 3), y << BRICK_BITS | (bit >> 2 & 3),
                            z << BRICK_BITS | bit >> 4,
                        )
                        rays = min(self.start[upper + 1] - self.start[upper], LONGEST)
                        if rays < CROWD:
                            continue
                        if histogram != NULL:
                            histogram[rays] += 1
                        elif rays > least:
                            self.give(<uint32_t>upper)
                        elif rays == least and left > 0:
                            self.give(<uint32_t>upper)
                            left -= 1

    cdef void give(self, uint32_t upper) noexcept nogil:
        """Give the next block to an upper voxel."""
        cdef uint64_t mask = (<uint64_t>1 << self.place_bits) - 1
        cdef uint64_t at = place_of(self, upper)
        while self.places[at]:
            at = (at + 1) & mask
        self.places[at] = (<uint64_t>upper + 1) << BLOCK_BITS | <uint64_t>self.given
        self.owner[self.given] = upper
        self.given += 1

    cdef void fill_blocks(self, int64_t first, int64_t last) noexcept:
        cdef int64_t block
        with nogil:
            for block in range(first, last):
                self.fill(block)

    cdef void fill(self, int64_t block) noexcept nogil:
        """Sort an upper voxel's entries by voxel, and note where each begins."""
        cdef int64_t next_of[LOWER]
        cdef int64_t end_of[LOWER]
        cdef int lowers = 1 << 3 * self.bits
        cdef int64_t first = self.start[self.owner[block]]
        cdef int64_t last = self.start[self.owner[block] + 1]
        cdef int64_t i, total = first
        cdef uint64_t word = 0
        cdef int k
        memset(&next_of[0], 0, sizeof(next_of))
        for i in range(first, last):
            next_of[lower_of(self, self.entries[i])] += 1
        for k in range(lowers):
            word |= <uint64_t>(next_of[k] > 0) << k
            total += next_of[k]
            end_of[k] = total
            next_of[k] = total - next_of[k]
            self.block_start[block * lowers + k] = <uint32_t>next_of[k]
        self.block_word[block] = word
        swap_into_place(&self.entries[0], &next_of[0], &end_of[0], lowers, 0)

    cdef bint any_within(self, const Range* r) noexcept nogil:
        """Tell whether any voxel of a range holds a ray."""
        cdef Range upper = uppers_of(self, r)
        cdef int cube[3]
        cdef int down
        cdef int level = covering_level(self, &upper)
        down = BRICK_BITS * level
        for cube[2] in range(upper.lo[2] >> down, (upper.hi[2] >> down) + 1):
            for cube[1] in range(upper.lo[1] >> down, (upper.hi[1] >> down) + 1):
                for cube[0] in range(upper.lo[0] >> down, (upper.hi[0] >> down) + 1):
                    if self.cube_within(level, &cube[0], r, &upper):
                        return True
        return False

    cdef bint cube_within(self, int level, const int* cube, const Range* r,
                          const Range* upper) noexcept nogil:
        """Tell whether any voxel of a range that is in a cube of some level holds a ray."""
        cdef Range part
        cdef int at[3]
        cdef int k, below = BRICK_BITS * (level - 1)
        if level == 1:
            return brick_within(self, r, upper, cube[0], cube[1], cube[2])
        if not occupied(self, level, cube[0], cube[1], cube[2]):
            return False
        for k in range(3):
            part.lo[k] = max(cube[k] << BRICK_BITS, upper.lo[k] >> below)
            part.hi[k] = min((cube[k] << BRICK_BITS) + (1 << BRICK_BITS) - 1, upper.hi[k] >> below)
        for at[2] in range(part.lo[2], part.hi[2] + 1):
            for at[1] in range(part.lo[1], part.hi[1] + 1):
                for at[0] in range(part.lo[0], part.hi[0] + 1):
                    if self.cube_within(level - 1, &at[0], r, upper):
                        return True
        return False
