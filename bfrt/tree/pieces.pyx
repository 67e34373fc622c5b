"""Treelets that are read one after another."""

cimport cython
from cpython.mem cimport PyMem_RawFree, PyMem_RawMalloc
from libc.stdint cimport int64_t, uint32_t, uint64_t

from bfrt.geometry.box cimport Box
from bfrt.records cimport BOX_BYTES, INDEX_BITS, NODE_BYTES, OFFSET_BYTES, Treelet
from bfrt.streams.atomic cimport atomic_add
from bfrt.streams.reader cimport SharedFile, prefetch_bytes
from bfrt.tree.forest cimport (
    Forest, TreeStream, keep_at, kept_at, room_to_keep, stream_at, treelet_at,
)
from bfrt.tree.reading cimport check_ends, check_nodes, read_at
from bfrt.tree.walk cimport Piece
from bfrt.treelets.node cimport Node


cdef inline Parts parts_of(const TreeStream* s, const Treelet* t) noexcept nogil:
    """Lay out a treelet; what is counted has records still to come."""
    cdef Parts parts
    parts.boxes = t.nodes * NODE_BYTES
    if not s.counted:
        parts.ends = parts.records = parts.boxes
        parts.size = parts.records + t.count * s.stride
        return parts
    parts.ends = parts.boxes + t.count * BOX_BYTES
    parts.size = parts.records = parts.ends + ((t.count + 1) * OFFSET_BYTES + 7) // 8 * 8
    return parts


cdef inline uint64_t records_of(const TreeStream* s) noexcept nogil:
    """Return how many records a stream has."""
    return (<SharedFile>s.record_file).size // s.stride


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
                raise MemoryError(f"a treelet of {n} bytes")
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
        if kept_at(self.forest, treelet) != NULL:
            return
        prefetch_bytes(<SharedFile>s.node_file, t.node * NODE_BYTES, t.nodes * NODE_BYTES)
        if not s.counted:
            prefetch_bytes(<SharedFile>s.record_file, t.first * s.stride, t.count * s.stride)

    cdef const Piece* read(self, uint32_t treelet) except NULL nogil:
        """Give a treelet, which is there until the next is read."""
        cdef const Treelet* t = treelet_at(self.forest, treelet)
        cdef const TreeStream* s = stream_at(self.forest, treelet)
        cdef Piece* p = &self.piece
        cdef Parts parts = parts_of(s, t)
        cdef unsigned char* memory = kept_at(self.forest, treelet)
        if memory == NULL:
            self.measure(s, t, &parts)
            memory = room_to_keep(self.forest, parts.size)
            if memory == NULL:
                self.grow(parts.size)
                self.fill(s, t, &parts, self.memory)
                memory = self.memory
            else:
                self.fill(s, t, &parts, memory)
                keep_at(self.forest, treelet, memory)
        p.kind, p.stride, p.frame, p.four = s.kind, s.stride, s.frame, s.four
        p.first = s.number << INDEX_BITS | t.first
        p.box, p.nodes = <const Box*>t, <const Node*>memory
        p.records = memory + parts.records
        p.boxes, p.ends, p.begin = NULL, NULL, 0
        if s.counted:
            p.boxes = <const Box*>(memory + parts.boxes)
            p.ends = <const uint32_t*>(memory + parts.ends) + 1
            p.begin = (<const uint32_t*>(memory + parts.ends))[0]
        return p

    cdef int measure(self, const TreeStream* s, const Treelet* t, Parts* parts) except -1 nogil:
        """Find the size of a treelet: that of polygons tell only the ends of their vertices."""
        cdef uint32_t ends[2]
        if not s.counted:
            return 0
        self.read_ends(s, t.first, 0, ends)
        self.read_ends(s, t.first + t.count, 0, ends + 1)
        check_ends(ends, 2, 0, records_of(s), <SharedFile>s.end_file)
        parts.size += (ends[1] - ends[0]) * s.stride
        return 0

    cdef int read_ends(self, const TreeStream* s, uint64_t before, uint32_t n,
                       uint32_t* ends) except -1 nogil:
        """Read where the records of n objects end, and before them those that come before."""
        ends[0] = 0
        if before:
            return read_at(
                <SharedFile>s.end_file, ends, (n + 1) * OFFSET_BYTES, (before - 1) * OFFSET_BYTES
            )
        return read_at(<SharedFile>s.end_file, ends + 1, n * OFFSET_BYTES, 0)

    cdef int fill(self, const TreeStream* s, const Treelet* t, const Parts* parts,
                  unsigned char* memory) except -1 nogil:
        """Read a treelet."""
        cdef uint32_t* ends
        cdef int64_t first = t.first
        read_at(<SharedFile>s.node_file, memory, t.nodes * NODE_BYTES, t.node * NODE_BYTES)
        check_nodes(<const Node*>memory, t.nodes, t.count, <SharedFile>s.node_file)
        if s.counted:
            ends = <uint32_t*>(memory + parts.ends)
            self.read_ends(s, t.first, t.count, ends)
            check_ends(ends, t.count + 1, 0, records_of(s), <SharedFile>s.end_file)
            read_at(
                <SharedFile>s.box_file, memory + parts.boxes, t.count * BOX_BYTES,
                t.first * BOX_BYTES,
            )
            first = ends[0]
        read_at(
            <SharedFile>s.record_file, memory + parts.records, parts.size - parts.records,
            first * s.stride,
        )
        atomic_add(&self.forest.treelets_read, 1)
        return 0
