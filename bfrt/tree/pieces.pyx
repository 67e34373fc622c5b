"""Treelets that are read as rays come to them.

::

    treelets that have rays ──► nodes, in few runs ──► those whose leaves rays meet
                                                                   │
                          rays go down  ◄── objects, in few runs ◄─┘

Half of the treelets that rays come to have no leaf that a ray meets: of these nodes alone are read,
a fifth of the bytes.
"""

cimport cython
from libc.stdint cimport int64_t, uint8_t, uint32_t, uint64_t

from bfrt.geometry.box cimport Box
from bfrt.records cimport BOX_BYTES, INDEX_BITS, NODE_BYTES, OFFSET_BYTES, Treelet
from bfrt.streams.atomic cimport atomic_add
from bfrt.streams.reader cimport SharedFile
from bfrt.streams.runs cimport RunReader
from bfrt.tree.forest cimport (
    Forest, TreeStream, keep_nodes, kept_nodes, stream_at, treelet_at,
)
from bfrt.tree.reading cimport check_ends, check_nodes
from bfrt.tree.walk cimport Piece
from bfrt.treelets.node cimport Node

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
            self.node[k] = kept_nodes(self.forest, treelets[k])
            t, s = treelet_at(self.forest, treelets[k]), stream_at(self.forest, treelets[k])
            if self.node[k] == NULL:
                at[k] = self.nodes.add(
                    <SharedFile>s.node_file, t.node * NODE_BYTES, t.nodes * NODE_BYTES
                )
                if at[k] < 0:
                    break
            self.count = k + 1
        self.nodes.read()
        for k in range(self.count):
            if self.node[k] == NULL:
                t, s = treelet_at(self.forest, treelets[k]), stream_at(self.forest, treelets[k])
                self.node[k] = <const Node*>(self.nodes.memory + at[k])
                check_nodes(self.node[k], t.nodes, t.count, <SharedFile>s.node_file)
                keep_nodes(self.forest, treelets[k], self.node[k])
                atomic_add(&self.forest.treelets_read, 1)
        return self.count

    cdef const Piece* glance(self, int k) noexcept nogil:
        """Give the nodes of a treelet of the batch."""
        cdef const Treelet* t = treelet_at(self.forest, self.treelets[k])
        cdef const TreeStream* s = stream_at(self.forest, self.treelets[k])
        cdef Piece* p = &self.piece
        p.kind, p.stride, p.frame, p.four = s.kind, s.stride, s.frame, s.four
        p.first = s.number << INDEX_BITS | t.first
        p.box, p.nodes = <const Box*>t, self.node[k]
        p.records, p.boxes, p.ends, p.begin = NULL, NULL, NULL, 0
        return p

    cdef int read_objects(self, const uint8_t* wanted, int first) except -1 nogil:
        """Read the objects of those treelets of the batch that are wanted, from `first` on; return
        the end of those for which there is room.
        """
        cdef int k, end, last
        self.ends.clear()
        self.boxes.clear()
        self.records.clear()
        end = self.count
        for k in range(first, end):
            if wanted[k]:
                self.parts[k].ends = self.add_ends(
                    stream_at(self.forest, self.treelets[k]),
                    treelet_at(self.forest, self.treelets[k]),
                )
                if self.parts[k].ends < 0:
                    end = k
                    break
        self.ends.read()
        last = first
        for k in range(first, end):
            if wanted[k] and not self.add_objects(k):
                break
            last = k + 1
        self.boxes.read()
        self.records.read()
        return last

    cdef int64_t add_ends(self, const TreeStream* s, const Treelet* t) noexcept nogil:
        """Have the ends of a treelet's records read, and of those before: -1 for no room."""
        cdef uint64_t before = t.first > 0
        if not s.counted:
            return 0
        return self.ends.add(
            <SharedFile>s.end_file, (t.first - before) * OFFSET_BYTES,
            (t.count + before) * OFFSET_BYTES,
        )

    cdef const uint32_t* ends_of(self, int k) noexcept nogil:
        """Return the ends of the records of a treelet's objects, which have been read."""
        cdef const Treelet* t = treelet_at(self.forest, self.treelets[k])
        return <const uint32_t*>(self.ends.memory + self.parts[k].ends) + (t.first > 0)

    cdef int add_objects(self, int k) except -1 nogil:
        """Have the objects of a treelet read; false if there is no room for them."""
        cdef const Treelet* t = treelet_at(self.forest, self.treelets[k])
        cdef const TreeStream* s = stream_at(self.forest, self.treelets[k])
        cdef const uint32_t* ends
        cdef uint64_t first = t.first, count = t.count
        if s.counted:
            ends = self.ends_of(k)
            first = (ends - 1)[0] if t.first > 0 else 0
            check_ends(ends, t.count, <uint32_t>first, records_of(s), <SharedFile>s.end_file)
            count = ends[t.count - 1] - first
            self.parts[k].boxes = self.boxes.add(
                <SharedFile>s.box_file, t.first * BOX_BYTES, t.count * BOX_BYTES
            )
            if self.parts[k].boxes < 0:
                return False
        self.parts[k].records = self.records.add(
            <SharedFile>s.record_file, first * s.stride, count * s.stride
        )
        return self.parts[k].records >= 0

    cdef const Piece* whole(self, int k) noexcept nogil:
        """Give a treelet of the batch whose objects have been read."""
        cdef const TreeStream* s = stream_at(self.forest, self.treelets[k])
        cdef Piece* p = &self.piece
        self.glance(k)
        p.records = self.records.memory + self.parts[k].records
        if s.counted:
            p.boxes = <const Box*>(self.boxes.memory + self.parts[k].boxes)
            p.ends = self.ends_of(k)
            p.begin = (p.ends - 1)[0] if treelet_at(self.forest, self.treelets[k]).first > 0 else 0
        return p
