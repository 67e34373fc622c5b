"""Parts of treelets as they are read: all of them, and what they have to be."""

from libc.errno cimport EINTR, errno
from libc.stdint cimport int64_t, uint32_t, uint64_t

from bfrt.streams.atomic cimport atomic_add
from bfrt.streams.reader cimport SharedFile
from bfrt.treelets.node cimport INNER, LARGEST_LEAF, WIDE, Node

from bfrt.errors import ShortReadError, StoreError, StreamError

cpdef enum:
    DEEPEST_NODE = 48  # levels of nodes that walks have room for (walk.pxd)

cdef extern from "unistd.h" nogil:
    ssize_t pread(int fd, void* buffer, size_t n, int64_t offset)


cdef int read_at(SharedFile file, void* buffer, size_t n, int64_t offset) except -1 nogil:
    """Read n bytes of a file, which are there."""
    cdef size_t done = 0
    cdef ssize_t got
    atomic_add(&file.seeks, file.last_end != offset)
    while done < n:
        got = pread(file.prefetch_fd, <char*>buffer + done, n - done, offset + <int64_t>done)
        if got > 0:
            done += got
        elif got == 0:
            with gil:
                raise ShortReadError(file.path, offset + done, n - done, 0)
        elif errno != EINTR:
            with gil:
                raise StreamError(file.path, offset + done, errno, "reading")
    file.last_end = offset + <int64_t>n
    atomic_add(&file.bytes_read, n)
    return 0


cdef int check_nodes(const Node* nodes, uint32_t n, uint32_t objects,
                     SharedFile file) except -1 nogil:
    """Refuse nodes that are not as the builder lays them out, whatever is on the disk.

    They are breadth first: each node's children follow those of the nodes before.
    """
    cdef const Node* node
    cdef uint32_t k, child = 1, level = 1
    cdef uint64_t all_leaves = 0, own
    cdef int c, depth = 1
    cdef bint good = True
    for k in range(n):
        node = nodes + k
        if k == level:  # the nodes of a level have been looked at
            depth, level = depth + 1, child
        good = good and node.child == child and depth <= DEEPEST_NODE
        own = 0
        for c in range(WIDE):
            good = good and (node.count[c] == INNER) == (node.inner >> c & 1)
            if node.count[c] == INNER:
                child += 1
            else:
                own += node.count[c]
                good = good and node.count[c] <= LARGEST_LEAF
        good = good and node.first + own <= objects
        all_leaves += own
    if not (good and child == n and all_leaves <= objects):
        with gil:
            raise StoreError(
                f"{file.path}: found nodes that are no tree of their treelet, expected one"
            )
    return 0


cdef int check_ends(const uint32_t* ends, int64_t n, uint32_t begin, uint64_t records,
                    SharedFile file) except -1 nogil:
    """Refuse ends of objects' records that descend, or are beyond the records."""
    cdef int64_t i
    cdef uint32_t before = begin
    for i in range(n):
        if ends[i] < before or ends[i] > records:
            with gil:
                raise StoreError(
                    f"{file.path}: found an end at vertex {ends[i]}, expected {before} to {records}"
                )
        before = ends[i]
    return 0
