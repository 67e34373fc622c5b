"""Parts of treelets as they are read."""

from libc.stdint cimport int64_t, uint32_t, uint64_t

from bfrt.streams.reader cimport SharedFile
from bfrt.treelets.node cimport Node

cdef int read_at(SharedFile file, void* buffer, size_t n, int64_t offset) except -1 nogil
cdef int check_nodes(const Node* nodes, uint32_t n, uint32_t objects,
                     SharedFile file) except -1 nogil
cdef int check_ends(const uint32_t* ends, int64_t n, uint32_t begin, uint64_t records,
                    SharedFile file) except -1 nogil
