"""Treelets that are read as rays come to them: a worker's memory for some that are together."""

from libc.stdint cimport int64_t, uint32_t

from bfrt.streams.reader cimport SharedFile
from bfrt.streams.runs cimport RunReader
from bfrt.tree.forest cimport Forest
from bfrt.tree.sketch cimport Begins
from bfrt.tree.walk cimport Piece, Range
from bfrt.treelets.node cimport Node

cdef enum:
    TOGETHER = 128  # treelets that are looked at together

# Which objects of a treelet are read, and where the parts of these come to in memory.
cdef struct Parts:
    Range wanted
    int64_t records
    int64_t boxes
    int64_t ends


cdef class PieceReader:
    cdef Forest forest
    cdef RunReader nodes
    cdef RunReader records
    cdef RunReader boxes    # of those that are counted, as are ends
    cdef RunReader ends
    cdef const uint32_t* treelets   # of the batch
    cdef int count
    cdef const Node* node[TOGETHER]
    cdef const Begins* begins[TOGETHER]
    cdef Parts parts[TOGETHER]
    cdef Piece piece

    cdef int begin(self, const uint32_t* treelets, int64_t n) except -1 nogil
    cdef const Piece* glance(self, int k) noexcept nogil
    cdef int read_objects(self, const Range* wanted, int first) except -1 nogil
    cdef int refuse(self, SharedFile file, int64_t room) except -1 nogil
    cdef bint add_ends(self, int k, Range wanted) noexcept nogil
    cdef const uint32_t* ends_of(self, int k, uint32_t* before) noexcept nogil
    cdef int add_objects(self, int k, Range wanted) except -1 nogil
    cdef const Piece* whole(self, int k) noexcept nogil
