"""Treelets that are read one after another: a worker's memory for the one at hand."""

from libc.stdint cimport uint32_t

from bfrt.records cimport Treelet
from bfrt.tree.forest cimport Forest, TreeStream
from bfrt.tree.walk cimport Piece


cdef class PieceReader:
    cdef Forest forest
    cdef unsigned char* memory
    cdef size_t capacity
    cdef Piece piece

    cdef const Piece* read(self, uint32_t treelet) except NULL nogil
    cdef int read_counted(self, const TreeStream* s, const Treelet* t) except -1 nogil
    cdef int read_ends(self, const TreeStream* s, const Treelet* t, size_t at,
                       uint32_t begin) except -1 nogil
    cdef int grow(self, size_t n) except -1 nogil
    cdef void prefetch(self, uint32_t treelet) noexcept nogil
