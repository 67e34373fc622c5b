"""Treelets that are read one after another: a worker's memory for the one at hand."""

from libc.stdint cimport uint32_t, uint64_t

from bfrt.records cimport Treelet
from bfrt.tree.forest cimport Forest, TreeStream
from bfrt.tree.walk cimport Piece


# Where the parts of a treelet begin, after its nodes, and all of them end.
cdef struct Parts:
    size_t boxes
    size_t ends
    size_t records
    size_t size


cdef class PieceReader:
    cdef Forest forest
    cdef unsigned char* memory
    cdef size_t capacity
    cdef Piece piece

    cdef const Piece* read(self, uint32_t treelet) except NULL nogil
    cdef int measure(self, const TreeStream* s, const Treelet* t, Parts* parts) except -1 nogil
    cdef int read_ends(self, const TreeStream* s, uint64_t before, uint32_t n,
                       uint32_t* ends) except -1 nogil
    cdef int fill(self, const TreeStream* s, const Treelet* t, const Parts* parts,
                  unsigned char* memory) except -1 nogil
    cdef int grow(self, size_t n) except -1 nogil
    cdef void prefetch(self, uint32_t treelet) noexcept nogil
