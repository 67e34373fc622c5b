"""Treelets that are read one after another."""

cimport cython
from cpython.mem cimport PyMem_RawFree, PyMem_RawMalloc
from libc.stdint cimport uint32_t

from bfrt.geometry.box cimport Box
from bfrt.records cimport BOX_BYTES, INDEX_BITS, NODE_BYTES, OFFSET_BYTES, Treelet
from bfrt.streams.atomic cimport atomic_add
from bfrt.streams.reader cimport SharedFile, prefetch_bytes
from bfrt.tree.forest cimport Forest, TreeStream, stream_at, treelet_at
from bfrt.tree.reading cimport check_ends, check_nodes, read_at
from bfrt.tree.walk cimport Piece
from bfrt.treelets.node cimport Node


@cython.final
cdef class PieceReader:
    """Reads treelets of a forest into one worker's memory.

    Parameters
    ----------
    forest : Forest
        One that is not resident.
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

    @staticmethod
    def bytes(store):
        """Return the bytes of one worker's memory."""
        return max((stream.treelet_bytes for stream in store.streams), default=0)

    cdef void prefetch(self, uint32_t treelet) noexcept nogil:
        """Have the system begin to read a treelet."""
        cdef const Treelet* t = treelet_at(self.forest, treelet)
        cdef const TreeStream* s = stream_at(self.forest, treelet)
        prefetch_bytes(<SharedFile>s.node_file, t.node * NODE_BYTES, t.nodes * NODE_BYTES)
        if not s.counted:
            prefetch_bytes(<SharedFile>s.record_file, t.first * s.stride, t.count * s.stride)

    cdef const Piece* read(self, uint32_t treelet) except NULL nogil:
        """Give a treelet, which is there until the next is read."""
        cdef const Treelet* t = treelet_at(self.forest, treelet)
        cdef const TreeStream* s = stream_at(self.forest, treelet)
        cdef Piece* p = &self.piece
        cdef size_t nodes = t.nodes * NODE_BYTES, records = t.count * s.stride
        atomic_add(&self.forest.treelets_read, 1)
        p.kind, p.stride, p.frame, p.four = s.kind, s.stride, s.frame, s.four
        p.first = s.number << INDEX_BITS | t.first
        p.boxes, p.ends, p.begin = NULL, NULL, 0
        if s.counted:
            self.read_counted(s, t)
        else:
            self.grow(nodes + records)
            read_at(<SharedFile>s.record_file, self.memory + nodes, records, t.first * s.stride)
            p.records = self.memory + nodes
        read_at(<SharedFile>s.node_file, self.memory, nodes, t.node * NODE_BYTES)
        p.box, p.nodes = <const Box*>t, <const Node*>self.memory
        check_nodes(p.nodes, t.nodes, t.count, <SharedFile>s.node_file)
        return p

    cdef int read_counted(self, const TreeStream* s, const Treelet* t) except -1 nogil:
        """Read the records of a treelet whose objects have several each, and where they end."""
        cdef Piece* p = &self.piece
        cdef size_t boxes = t.nodes * NODE_BYTES
        cdef size_t ends = boxes + t.count * BOX_BYTES
        cdef size_t records = ends + (t.count * OFFSET_BYTES + 7) // 8 * 8
        cdef size_t size
        cdef uint32_t begin = 0
        if t.first:
            read_at(
                <SharedFile>s.end_file, &begin, OFFSET_BYTES, (t.first - 1) * OFFSET_BYTES
            )
        self.grow(records)
        self.read_ends(s, t, ends, begin)
        size = (p.ends[t.count - 1] - begin) * s.stride
        if records + size > self.capacity:
            self.grow(records + size)
            self.read_ends(s, t, ends, begin)
        read_at(
            <SharedFile>s.box_file, self.memory + boxes, t.count * BOX_BYTES, t.first * BOX_BYTES
        )
        read_at(<SharedFile>s.record_file, self.memory + records, size, begin * s.stride)
        p.boxes, p.begin = <const Box*>(self.memory + boxes), begin
        p.records = self.memory + records
        return 0

    cdef int read_ends(self, const TreeStream* s, const Treelet* t, size_t at,
                       uint32_t begin) except -1 nogil:
        """Read where the records of a treelet's objects end."""
        cdef uint32_t* ends = <uint32_t*>(self.memory + at)
        read_at(<SharedFile>s.end_file, ends, t.count * OFFSET_BYTES, t.first * OFFSET_BYTES)
        check_ends(
            ends, t.count, begin, (<SharedFile>s.record_file).size // s.stride,
            <SharedFile>s.end_file,
        )
        self.piece.ends = ends
        return 0
