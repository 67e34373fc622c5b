"""Numbers that look random, and are the same for all threads and in any order."""

from libc.stdint cimport uint64_t

cdef extern from *:
    """
    /* The golden ratio's part behind the point, in units of 2^-64: steps of it spread evenly. */
    #define BFRT_GOLDEN 0x9E3779B97F4A7C15u
    """
    const uint64_t GOLDEN "BFRT_GOLDEN"


cdef inline uint64_t mixed(uint64_t x) noexcept nogil:
    """Hash x: the finalizer of SplitMix64 (Steele, Lea and Flood 2014)."""
    x += GOLDEN
    x = (x ^ (x >> 30)) * <uint64_t>0xBF58476D1CE4E5B9
    x = (x ^ (x >> 27)) * <uint64_t>0x94D049BB133111EB
    return x ^ (x >> 31)


cdef inline double uniform(uint64_t x) noexcept nogil:
    """Return a number in [0, 1) of a hash."""
    return (x >> 11) * (1.0 / 9007199254740992.0)
