"""The treelets of a store: the tree above them, which is always in memory, and each one's piece."""

from libc.stdint cimport int64_t, uint16_t, uint32_t, uint64_t

from bfrt.geometry.coordinates cimport Frame
from bfrt.records cimport Treelet
from bfrt.streams.reader cimport SharedFile
from bfrt.tree.top cimport Top
from bfrt.tree.walk cimport Piece

# A stream as its treelets need it; the pointers are NULL where it is read treelet by treelet.
cdef struct TreeStream:
    int kind
    bint counted
    size_t stride
    Frame frame
    uint64_t number
    const unsigned char* nodes
    const unsigned char* records
    const uint32_t* ends
    void* node_file         # SharedFiles
    void* geometry_file
    void* offset_file       # NULL where each object has one record


cdef class Forest:
    cdef readonly int64_t treelets
    cdef readonly double padding
    cdef readonly bint resident
    cdef Top top
    cdef const Treelet* treelet
    cdef const uint16_t[::1] stream_of  # of each treelet, by its place in `streams`
    cdef TreeStream* streams
    cdef list kept      # what the pointers point into
    cdef list files

    cdef void* opened(self, stream, name) except NULL
    cdef object keep(self, array)
    cdef void resident_piece(self, uint32_t treelet, Piece* p) noexcept nogil
