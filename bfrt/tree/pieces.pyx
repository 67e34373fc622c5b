"""Treelets that are read one after another."""

cimport cython
from cpython.mem cimport PyMem_RawFree, PyMem_RawMalloc
from libc.errno cimport EINTR, errno
from libc.stdint cimport int64_t, uint32_t

from bfrt.records cimport INDEX_BITS, NODE_BYTES, OFFSET_BYTES, Treelet
from bfrt.streams.atomic cimport atomic_add
from bfrt.streams.reader cimport SharedFile, prefetch_bytes
from bfrt.tree.forest cimport Forest, TreeStream
from bfrt.tree.walk cimport Piece
from bfrt.treelets.node cimport INNER, WIDE, Node

from bfrt.errors import ShortReadError, StoreError, StreamError

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


cdef int check_nodes(const Node* nodes, uint32_t n, uint32_t objects) except -1 nogil:
    """Refuse nodes that lead out of their treelet, or around: whatever is on the disk."""
    cdef const Node* node
    cdef uint32_t k, child, first
    cdef int c
    cdef bint good = n > 0
    for k in range(n):
        node = nodes + k
        child, first = node.child, node.first
        for c in range(WIDE):
            if node.count[c] == INNER:
                good = good and (node.inner >> c & 1)
                child += 1
            else:
                good = good and not (node.inner >> c & 1)
                first += node.count[c]
        good = good and first <= objects and first >= node.first
        good = good and (node.inner == 0 or (node.child > k and child <= n and child > node.child))
    if not good:
        with gil:
            raise StoreError("nodes: found a treelet whose nodes lead nowhere, expected a tree")
    return 0


@cython.final
cdef class PieceReader:
    """Reads treelets of a forest into one worker's memory.

    Parameters
    ----------
    forest : Forest
    """

    def __cinit__(self, Forest forest not None):
        self.forest = forest

    def __dealloc__(self):
        PyMem_RawFree(self.memory)

    cdef int grow(self, size_t n) except -1 nogil:
        """See that there is memory for n bytes."""
        if n <= self.capacity:
            return 0
        with gil:
            PyMem_RawFree(self.memory)
            self.capacity = 0
            self.memory = <unsigned char*>PyMem_RawMalloc(n)
            if self.memory == NULL:
                raise MemoryError(f"{n} bytes for a treelet")
            self.capacity = n
        return 0

    cdef void prefetch(self, uint32_t treelet) noexcept nogil:
        """Have the system begin to read a treelet."""
        cdef const Treelet* t = &self.forest.treelet[treelet]
        cdef const TreeStream* s = &self.forest.streams[self.forest.stream_of[treelet]]
        if self.forest.resident:
            return
        prefetch_bytes(<SharedFile>s.node_file, t.node * NODE_BYTES, t.nodes * NODE_BYTES)
        if not s.counted:
            prefetch_bytes(<SharedFile>s.geometry_file, t.first * s.stride, t.count * s.stride)

    cdef const Piece* read(self, uint32_t treelet) except NULL nogil:
        """Give a treelet, which is there until the next is read."""
        cdef const Treelet* t = &self.forest.treelet[treelet]
        cdef const TreeStream* s = &self.forest.streams[self.forest.stream_of[treelet]]
        cdef Piece* p = &self.piece
        cdef size_t nodes = t.nodes * NODE_BYTES, records = t.count * s.stride
        if self.forest.resident:
            self.forest.resident_piece(treelet, p)
            return p
        p.kind, p.stride, p.frame = s.kind, s.stride, s.frame
        p.first = s.number << INDEX_BITS | t.first
        p.ends, p.begin = NULL, 0
        if s.counted:
            self.read_counted(s, t)
        else:
            self.grow(nodes + records)
            read_at(
                <SharedFile>s.geometry_file, self.memory + nodes, records, t.first * s.stride
            )
            p.records = self.memory + nodes
        read_at(<SharedFile>s.node_file, self.memory, nodes, t.node * NODE_BYTES)
        p.nodes = <const Node*>self.memory
        check_nodes(p.nodes, t.nodes, t.count)
        return p

    cdef int read_counted(self, const TreeStream* s, const Treelet* t) except -1 nogil:
        """Read the records of a treelet whose objects have several each, and where they end."""
        cdef Piece* p = &self.piece
        cdef size_t nodes = t.nodes * NODE_BYTES, ends = t.count * OFFSET_BYTES
        cdef uint32_t begin = 0, end = 0, i
        cdef const uint32_t* each
        if t.first:
            read_at(<SharedFile>s.offset_file, &begin, OFFSET_BYTES, (t.first - 1) * OFFSET_BYTES)
        read_at(
            <SharedFile>s.offset_file, &end, OFFSET_BYTES, (t.first + t.count - 1) * OFFSET_BYTES
        )
        self.grow(nodes + ends + (end - begin if end > begin else 0) * s.stride)
        read_at(<SharedFile>s.offset_file, self.memory + nodes, ends, t.first * OFFSET_BYTES)
        each = <const uint32_t*>(self.memory + nodes)
        for i in range(t.count):
            if each[i] < (each[i - 1] if i else begin) or each[i] > end:
                with gil:
                    raise StoreError(
                        f"{(<SharedFile>s.offset_file).path}: object {t.first + i}: found an end at "
                        f"vertex {each[i]}, expected ascending ones that are there"
                    )
        read_at(
            <SharedFile>s.geometry_file, self.memory + nodes + ends, (end - begin) * s.stride,
            begin * s.stride,
        )
        p.ends, p.begin, p.records = each, begin, self.memory + nodes + ends
        return 0
