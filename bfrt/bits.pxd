"""Bits of a word (GCC's and Clang's builtins)."""

from libc.stdint cimport uint64_t

cdef extern from *:
    """
    #define bfrt_ones(word) __builtin_popcountll(word)
    #define bfrt_lowest_bit(word) __builtin_ctzll(word)
    /* Where there is no instruction for it a call for 64 bits costs more than this. */
    static inline unsigned bfrt_ones_of_eight(unsigned bits) {
        bits -= bits >> 1 & 0x55;
        bits = (bits & 0x33) + (bits >> 2 & 0x33);
        return (bits + (bits >> 4)) & 0x0f;
    }
    """
    int ones "bfrt_ones"(uint64_t word) noexcept nogil
    int ones_of_eight "bfrt_ones_of_eight"(unsigned int bits) noexcept nogil
    int lowest_bit "bfrt_lowest_bit"(uint64_t word) noexcept nogil
