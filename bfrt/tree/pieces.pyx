"""Treelets that are read as rays come to them.

::

    treelets that have rays ──► nodes, in few runs, or a sketch ──► those whose leaves rays meet
                                                                   │
                          rays go down  ◄── objects, in few runs ◄─┘

Half of the treelets that rays come to have no leaf that a ray meets: of these nodes alone are read,
a fifth of the bytes.
"""

cimport cython
from libc.stdint cimport int64_t, uint32_t, uint64_t

from bfrt.geometry.box cimport Box
from bfrt.records cimport BOX_BYTES, INDEX_BITS, NODE_BYTES, OFFSET_BYTES, Treelet
from bfrt.streams.atomic cimport atomic_add
from bfrt.streams.reader cimport SharedFile
from bfrt.streams.runs cimport RunReader
from bfrt.tree.forest cimport (
    Forest, TreeStream, begins_at, sketch, sketch_of, stream_at, treelet_at,
)
from bfrt.tree.reading cimport check_ends, check_nodes
from bfrt.tree.walk cimport Piece, Range
from bfrt.treelets.node cimport Node

from bfrt.errors import StoreError

#: Bytes of a worker's memory for the parts of treelets; more where a treelet is larger.
NODES_READ = 1 << 19
RECORDS_READ = 1 << 21
BOXES_READ = 1 << 19
ENDS_READ = 1 << 16


def rooms(store):
    """Return the bytes of one worker's memory for nodes, records, boxes and ends."""
    largest = RunReader.room(max((stream.treelet_bytes for stream in store.streams), default=0))
    counted = any(stream.kind.counted and stream.treelets for stream in store.streams)
    nodes, records = max(NODES_READ, largest), max(RECORDS_READ, largest)
    return nodes, records, *[counted * max(n, largest) for n in (BOXES_READ, ENDS_READ)]


cdef inline uint64_t records_of(const TreeStream* s) noexcept nogil:
    """Return how many records a stream has."""
    return (<SharedFile>s.record_file).size // s.stride


@cython.final
cdef class PieceReader:
    """Reads treelets of a forest into one worker's memory: nodes first, objects where they count.

    Parameters
    ----------
    forest : Forest
        One that is not resident.
    room : tuple of 4 int
        As `rooms` returns it.
    """

    def __cinit__(self, Forest forest not None, room):
        self.forest = forest
        self.nodes, self.records, self.boxes, self.ends = map(RunReader, room)

    @staticmethod
    def bytes(store):
        """Return the bytes of one worker's memory."""
        return sum(RunReader.room(room) for room in rooms(store))

    cdef int begin(self, const uint32_t* treelets, int64_t n) except -1 nogil:
        """Begin with some of n treelets, ascending: read their nodes; return how many they are."""
        cdef const Treelet* t
        cdef const TreeStream* s
        cdef int64_t at[TOGETHER]
        cdef int k
        self.nodes.clear()
        self.treelets, self.count = treelets, 0
        for k in range(<int>min(n, <int64_t>TOGETHER)):
            self.node[k], self.begins[k] = sketch_of(self.forest, treelets[k]), NULL
            t, s = treelet_at(self.forest, treelets[k]), stream_at(self.forest, treelets[k])
            if self.node[k] == NULL:
                at[k] = self.nodes.add(
                    <SharedFile>s.node_file, t.node * NODE_BYTES, t.nodes * NODE_BYTES
                )
                if at[k] < 0:
                    break
            else:
                self.begins[k] = begins_at(self.forest, self.node[k])
            self.count = k + 1
        if self.count == 0 and n > 0:
            self.refuse(<SharedFile>s.node_file, self.nodes.capacity)
        self.nodes.read()
        for k in range(self.count):
            if self.node[k] == NULL:
                t, s = treelet_at(self.forest, treelets[k]), stream_at(self.forest, treelets[k])
                self.node[k] = <const Node*>(self.nodes.memory + at[k])
                check_nodes(self.node[k], t.nodes, t.count, <SharedFile>s.node_file)
                sketch(self.forest, treelets[k], self.node[k])
                atomic_add(&self.forest.treelets_read, 1)
        return self.count

    cdef const Piece* glance(self, int k) noexcept nogil:
        """Give the nodes of a treelet of the batch."""
        cdef const Treelet* t = treelet_at(self.forest, self.treelets[k])
        cdef const TreeStream* s = stream_at(self.forest, self.treelets[k])
        cdef Piece* p = &self.piece
        p.kind, p.stride, p.frame, p.four = s.kind, s.stride, s.frame, s.four
        p.first, p.objects = s.number << INDEX_BITS | t.first, <uint32_t>t.count
        p.box, p.nodes, p.begins = <const Box*>t, self.node[k], self.begins[k]
        p.records, p.boxes, p.ends, p.begin, p.skipped = NULL, NULL, NULL, 0, 0
        return p

    cdef int read_objects(self, const Range* wanted, int first) except -1 nogil:
        """Read what is wanted of the objects of the batch's treelets, from `first` on; return the
        end of those for which there is room.
        """
        cdef int k, end = self.count, last = first
        cdef const TreeStream* s
        self.ends.clear()
        self.boxes.clear()
        self.records.clear()
        for k in range(first, end):
            if wanted[k].end and not self.add_ends(k, wanted[k]):
                end = k
                break
        self.ends.read()
        for k in range(first, end):
            if wanted[k].end and not self.add_objects(k, wanted[k]):
                break
            last = k + 1
        if last == first:   # alone it has all of the memory
            s = stream_at(self.forest, self.treelets[first])
            self.refuse(<SharedFile>s.record_file, self.records.capacity)
        self.boxes.read()
        self.records.read()
        return last

    cdef int refuse(self, SharedFile file, int64_t room) except -1 nogil:
        """Refuse a treelet that is larger than the largest of which the header tells."""
        with gil:
            raise StoreError(
                f"{file.path}: found a treelet of more bytes than the header tells of, "
                f"expected at most {room}"
            )

    cdef bint add_ends(self, int k, Range wanted) noexcept nogil:
        """Have the ends of objects' records read, and those of the objects before; false if there
        is no room for them.
        """
        cdef const TreeStream* s = stream_at(self.forest, self.treelets[k])
        cdef int64_t begin = treelet_at(self.forest, self.treelets[k]).first + wanted.begin
        cdef int64_t before = begin > 0
        self.parts[k].wanted = wanted
        if not s.counted:
            return True
        self.parts[k].ends = self.ends.add(
            <SharedFile>s.end_file, (begin - before) * OFFSET_BYTES,
            (wanted.end - wanted.begin + before) * OFFSET_BYTES,
        )
        return self.parts[k].ends >= 0

    cdef const uint32_t* ends_of(self, int k, uint32_t* before) noexcept nogil:
        """Return the ends of the records of those objects of a treelet that have been read, and
        where those of the objects before end.
        """
        cdef const Parts* parts = &self.parts[k]
        cdef const uint32_t* ends = <const uint32_t*>(self.ends.memory + parts.ends)
        if treelet_at(self.forest, self.treelets[k]).first + parts.wanted.begin == 0:
            before[0] = 0
            return ends
        before[0] = ends[0]
        return ends + 1

    cdef int add_objects(self, int k, Range wanted) except -1 nogil:
        """Have objects of a treelet read; 0 if there is no room for them."""
        cdef const TreeStream* s = stream_at(self.forest, self.treelets[k])
        cdef uint64_t first = treelet_at(self.forest, self.treelets[k]).first + wanted.begin
        cdef uint64_t count = wanted.end - wanted.begin
        cdef const uint32_t* ends
        cdef uint32_t before
        if s.counted:
            self.parts[k].boxes = self.boxes.add(
                <SharedFile>s.box_file, first * BOX_BYTES, count * BOX_BYTES
            )
            if self.parts[k].boxes < 0:
                return 0
            ends = self.ends_of(k, &before)
            check_ends(ends, count, before, records_of(s), <SharedFile>s.end_file)
            first, count = before, ends[count - 1] - before
        self.parts[k].records = self.records.add(
            <SharedFile>s.record_file, first * s.stride, count * s.stride
        )
        return self.parts[k].records >= 0

    cdef const Piece* whole(self, int k) noexcept nogil:
        """Give a treelet of the batch of whose objects the wanted have been read.

        Its records begin, as far as the walk sees, where those of its first object would be.
        """
        cdef const TreeStream* s = stream_at(self.forest, self.treelets[k])
        cdef const Parts* parts = &self.parts[k]
        cdef Piece* p = &self.piece
        self.glance(k)
        p.records = self.records.memory + parts.records
        if s.counted:
            p.boxes = <const Box*>(self.boxes.memory + parts.boxes) - parts.wanted.begin
            p.ends = self.ends_of(k, &p.begin) - parts.wanted.begin
            p.skipped = parts.wanted.begin
        else:
            p.records -= parts.wanted.begin * s.stride
        return p
