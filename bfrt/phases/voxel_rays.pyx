"""The voxel ray store, on one level: a counting sort of the candidates, in place."""

cimport cython
from libc.stdint cimport int64_t, uint32_t, uint64_t
from libc.string cimport memmove

import numpy as np

cdef enum:
    PLACED_BIT = 63
    FEWEST = 16384  # candidates that are worth a second thread


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
        self.start = np.empty(int(np.prod(shape)) + 1, np.uint32)
        self.upper = np.empty(upper, np.uint8)

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
            Each sorts the candidates of a part of the voxels.
        """
        cdef int64_t n = self.pack(firsts, counts)
        parts = self.split(n, workers.threads)

        def part(_, first, last):
            for voxels, entries in parts[first:last]:
                self.sort_part(voxels[0], voxels[1], entries[0], entries[1])

        self.bricks[:] = 0
        self.upper[:] = 0
        workers.run(part, len(parts))
        self.start[self.start.shape[0] - 1] = n

    cdef int64_t pack(self, const int64_t[::1] firsts, const int64_t[::1] counts) noexcept:
        """Close the gaps between the segments; returns how many candidates there are."""
        cdef int64_t n = 0, i
        with nogil:
            for i in range(firsts.shape[0]):
                memmove(&self.entries[n], &self.entries[firsts[i]], counts[i] * sizeof(uint64_t))
                n += counts[i]
        return n

    def split(self, int64_t n, int parts):
        """Part the candidates by voxel: a list of ((voxels), (entries)), each first and last.

        The border lies near the median of a sample, between whole layers of bricks, so that no
        two workers share a brick. A grid without such a border is one part.
        """
        cdef int64_t layer = self.n[0] * <int64_t>self.n[1] << BRICK_BITS
        voxels = (0, self.start.shape[0] - 1)
        cdef int64_t border, at
        if parts < 2 or n < FEWEST:
            return [(voxels, (0, n))]
        sample = np.asarray(self.entries[:n:n // 255]) >> np.uint64(RAY_BITS + FACE_BITS)
        border = (int(np.median(sample)) + layer // 2) // layer * layer
        if not 0 < border < voxels[1]:
            return [(voxels, (0, n))]
        with nogil:
            at = self.partition(n, border)
        return [((0, border), (0, at)), ((border, voxels[1]), (at, n))]

    cdef int64_t partition(self, int64_t n, int64_t border) noexcept nogil:
        """Bring candidates of voxels below the border to the front; returns how many (Hoare)."""
        cdef int64_t i = 0, j = n
        cdef uint64_t entry
        while True:
            while i < j and entry_voxel(self.entries[i]) < border:
                i += 1
            while i < j and entry_voxel(self.entries[j - 1]) >= border:
                j -= 1
            if i >= j:
                return i
            j -= 1
            entry = self.entries[i]
            self.entries[i] = self.entries[j]
            self.entries[j] = entry
            i += 1

    cdef void sort_part(self, int64_t voxel, int64_t end, int64_t first,
                        int64_t last) noexcept:
        """Sort the candidates [first, last), all of voxels [voxel, end)."""
        with nogil:
            self.count(voxel, end, first, last)
            self.place(first, last)

    cdef void count(self, int64_t voxel, int64_t end, int64_t first,
                    int64_t last) noexcept nogil:
        """Set start[v] to where voxel v's entries end, and the bits of those that have any."""
        cdef int64_t i
        cdef uint32_t total = <uint32_t>first
        self.start[voxel:end] = 0
        for i in range(first, last):
            self.start[entry_voxel(self.entries[i])] += 1
        for i in range(voxel, end):
            if self.start[i]:
                self.occupy(<uint32_t>i)
                total += self.start[i]
            self.start[i] = total

    cdef void occupy(self, uint32_t voxel) noexcept nogil:
        """Set the voxel's bit, and its cube on every level up to the first that is set already."""
        cdef int x = voxel % self.n[0]
        cdef int y = (voxel // self.n[0]) % self.n[1]
        cdef int z = voxel // (self.n[0] * self.n[1])
        cdef int bit = (x & 3) | (y & 3) << 2 | (z & 3) << 4
        cdef int level
        cdef int64_t at
        for level in range(1, self.levels + 1):
            x >>= BRICK_BITS
            y >>= BRICK_BITS
            z >>= BRICK_BITS
            at = x + self.level_size[level][0] * (y + self.level_size[level][1] * <int64_t>z)
            if level == 1:
                if self.bricks[at]:
                    self.bricks[at] |= <uint64_t>1 << bit
                    return
                self.bricks[at] = <uint64_t>1 << bit
            else:
                at += self.level_begin[level]
                if self.upper[at]:
                    return
                self.upper[at] = 1

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
