"""The memory of rays in flight, which candidates share, and how complete rays leave it.

::

    RAY RAY RAY ...|                     candidates |
        active rays                                    the fewer there are, the more each gets
"""

from libc.stdint cimport int64_t
from libc.string cimport memmove

from bfrt.image.film cimport Film
from bfrt.phases.ray_records cimport finish_hit, finish_miss
from bfrt.records cimport EYE, NO_HIT, SHADOW, Hit, Path, Ray

import numpy as np

from bfrt.records import CANDIDATE_BYTES, PATH, RAY, RAY_BYTES

#: A ray's memory, in words, as candidates are counted.
RAY_WORDS = RAY_BYTES // CANDIDATE_BYTES


cdef class RaysInFlight:
    """Holds the memory of rays in flight.

    Parameters
    ----------
    capacity : int
        Rays at the most. All memory is taken here, and touched as rays come.
    words : int
        Words for candidates, of eight bytes, when there are `capacity` rays.

    Attributes
    ----------
    active : int
        Rays in flight: those at the front.
    """

    def __init__(self, int64_t capacity, int64_t words):
        cdef int64_t own = capacity * RAY_WORDS
        self.capacity = capacity
        self.memory = np.empty(own + words, np.uint64)
        self.records = self.rays = self.memory[:own].view(RAY)
        self.path_records = self.paths = np.empty(capacity, PATH)

    @property
    def all(self):
        """Return all of the memory: (capacity,) of records.RAY, and of records.PATH."""
        return self.records, self.path_records

    cdef object free(self):
        """Return the memory that active rays leave free for candidates: (n,) uint64."""
        return self.memory[self.active * RAY_WORDS:]

    def come(self, int64_t n):
        """Count `n` rays, admitted behind the active ones, as active."""
        self.active += n

    cdef bint complete(self, const Ray* r) noexcept nogil:
        """Tell whether a ray has no sentinel, or a nearer hit: strictly, so that all ties are met.
        """
        return True

    cdef object let_go(self, int64_t first, int64_t last, Film film, const double[::1] background,
                       Hit[::1] hits):
        """Let complete rays of a part go, and close its ranks.

        Parameters
        ----------
        first, last : int
            The part of the rays; those that stay are at its front afterwards.
        film : Film or None
            With one, rays that met nothing bring their light, or the background, to it.
        hits : (last - first or more,) records.HIT
            OUT: intersections that are to be shaded; without a film all rays, with the nearest hit
            so far. Shadow rays that have met something end anyway.

        Returns
        -------
        kept, n, eye_hits : int
            Rays that stay; those written; of them eye rays.
        """
        cdef int64_t i, kept = first, n = 0, eye_hits = 0
        cdef bint shaded = film is not None
        cdef Ray* r
        with nogil:
            for i in range(first, last):
                r = &self.rays[i]
                if not self.complete(r):
                    if kept != i:
                        self.rays[kept] = r[0]
                        self.paths[kept] = self.paths[i]
                    kept += 1
                elif shaded and r.id == NO_HIT:
                    finish_miss(r, &self.paths[i], film, &background[0])
                elif r.kind != SHADOW or r.id == NO_HIT:
                    finish_hit(r, &self.paths[i], &hits[n])
                    n += 1
                    eye_hits += r.kind == EYE
        return kept - first, n, eye_hits

    def compact(self, int64_t base, const int64_t[::1] firsts, const int64_t[::1] counts):
        """Move parts of the rays, ascending, together to `base`: behind them none is active."""
        cdef int64_t i, end = base
        with nogil:
            for i in range(firsts.shape[0]):
                memmove(&self.rays[end], &self.rays[firsts[i]], counts[i] * sizeof(Ray))
                memmove(&self.paths[end], &self.paths[firsts[i]], counts[i] * sizeof(Path))
                end += counts[i]
        self.active = end
