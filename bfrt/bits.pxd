"""Bits of a word (GCC's and Clang's builtins)."""

from libc.stdint cimport uint64_t

cdef extern from *:
    """
    #define bfrt_ones(word) __builtin_popcountll(word)
    #define bfrt_lowest_bit(word) __builtin_ctzll(word)
    """
    int ones "bfrt_ones"(uint64_t word) noexcept nogil
    int lowest_bit "bfrt_lowest_bit"(uint64_t word) noexcept nogil
