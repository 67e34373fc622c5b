"""Candidates of a pass, sorted by treelet.

They are counted, not compared: two runs over them take a sixth of the time of a sort in place, for
four bytes a candidate more.
"""

cimport cython
from libc.stdint cimport int64_t, uint32_t, uint64_t

import numpy as np


@cython.final
cdef class Candidates:
    """Holds pairs of a ray and a treelet.

    Parameters
    ----------
    treelets : int
        Of the forest.
    """

    def __cinit__(self, int64_t treelets):
        self.place = np.empty(treelets, np.int64)
        self.starts = np.empty(treelets + 1, np.int64)
        self.treelets = np.empty(treelets, np.uint32)

    @staticmethod
    def room(int64_t words):
        """Return how many candidates so many words have room for: eight bytes each, and four."""
        return words * 2 // 3

    @staticmethod
    def words(int64_t candidates):
        """Return how many words hold so many candidates."""
        return (3 * candidates + 1) // 2

    def begin(self, uint64_t[::1] memory):
        """Begin with no candidate, and memory for all that come."""
        cdef int64_t room = Candidates.room(memory.shape[0])
        self.found = memory[:room]
        self.rays = np.asarray(memory[room:]).view(np.uint32)
        self.used = 0

    def by_treelet(self):
        """Sort the candidates.

        Returns
        -------
        rays : (candidates,) uint32
            The rays, by treelet.
        treelets : (some,) uint32
            Those that have rays, ascending.
        starts : (some + 1,) int64
            Where the rays of each begin.
        """
        cdef int64_t n
        with nogil:
            n = self.sort()
        return self.rays[:self.used], self.treelets[:n], self.starts[:n + 1]

    cdef int64_t sort(self) noexcept nogil:
        """Put the rays at the places of their treelets; return how many of these have rays."""
        cdef int64_t i, count, n = 0, sum = 0
        cdef uint64_t each
        self.place[:] = 0
        for i in range(self.used):
            self.place[self.found[i] >> RAY_SHIFT] += 1
        for i in range(self.place.shape[0]):
            count = self.place[i]
            self.place[i] = sum
            if count:
                self.treelets[n], self.starts[n] = <uint32_t>i, sum
                n += 1
                sum += count
        self.starts[n] = sum
        for i in range(self.used):
            each = self.found[i]
            self.rays[self.place[each >> RAY_SHIFT]] = <uint32_t>each
            self.place[each >> RAY_SHIFT] += 1
        return n
