"""The treelets of a store."""

cimport cython
from cpython.mem cimport PyMem_RawFree, PyMem_RawMalloc
from libc.stdint cimport int32_t, int64_t, uint8_t, uint32_t
from libc.string cimport memset

import numpy as np

from bfrt.geometry.box cimport Box, box_add, box_clear
from bfrt.geometry.coordinates cimport frame_of
from bfrt.geometry.four cimport four_test
from bfrt.records cimport BOX_BYTES, INDEX_BITS, NODE_BYTES, OFFSET_BYTES, TREELET_BYTES, Treelet
from bfrt.streams.atomic cimport atomic_add, atomic_exchange, lock, publish, published, unlock
from bfrt.streams.reader cimport SharedFile
from bfrt.tree.reading cimport check_ends, check_nodes, read_at
from bfrt.tree.sight cimport spans_of
from bfrt.tree.sketch cimport DRAWN_BYTES, FEWEST_DRAWN, MOST_DRAWN
from bfrt.tree.top cimport extent_of
from bfrt.tree.walk cimport Piece
from bfrt.treelets.node cimport Node

from bfrt.errors import StoreError
from bfrt.records import TREELET
from bfrt.treelets.build import TreeletBuilder

#: Memory that the tree above takes for a treelet, at the most, while it is made: the treelet, its
#: reference, its places in the order and among the leaves, a part of a node as it is made and as it
#: stays, its stream, its state, its sketch's place; its number and two places among those
#: that have rays.
TREELET_SHARE = TREELET_BYTES + 32 + 3 * 4 + 2 * NODE_BYTES // 4 + 2 + 2 + 4 + (8 + 8 + 4)

#: The files that treelets consist of.
PARTS = "nodes", "geometry", "boxes", "offsets", "ids"


def table_of(stream):
    """Read a stream's treelets, (treelets,) of records.TREELET, which follow one another.

    Between them may be objects that nothing can hit, at the end of a window, which are in none.

    Raises
    ------
    StoreError
        If they do not, have no objects or nodes, or boxes that are none.
    StreamError
        As the system refuses.
    """
    path, table = stream.path("treelets"), stream.load("treelets", TREELET)
    good = len(table) == stream.treelets
    for begin, size, end in (("first", "count", stream.count), ("node", "nodes", stream.nodes)):
        begins, sizes = table[begin], table[size].astype(np.uint64)
        following = np.append(begins[1:], np.uint64(end))
        fits = (begins <= end) & (sizes > 0) & (begins + sizes <= following)
        good = good and bool(fits.all())
    for axis in "xyz":
        low, high = table[f"lo{axis}"], table[f"hi{axis}"]
        good = good and bool((np.isfinite(low) & np.isfinite(high) & (low <= high)).all())
    if not good:
        raise StoreError(f"{path}: found treelets that do not follow one another, expected all")
    return table


@cython.final
cdef class Forest:
    """Holds the tree above the treelets of a store, and treelets where memory has room for all.

    Those are read when a ray first comes to them, or many at once by `load_part`, and stay.

    Parameters
    ----------
    store : bfrt.store.store.Store
        All of whose streams are in spatial order.
    padding : float
        d, by which boxes are padded (docs/algorithm.rst, Exactness).
    resident : bool
        Whether treelets stay in memory.
    kept : int
        Bytes for sketches of treelets that stream, which are drawn when their nodes are read, and
        for the first node of each, if half of the bytes hold them.
    direct : bool
        Whether what streams is read past the system's cache.
    plain : bool
        Whether boxes are tested without wide vectors; it changes no answer.

    Attributes
    ----------
    treelets : int
        Number of treelets.

    Raises
    ------
    StoreError
        If the treelets are not what they should be.
    """

    def __cinit__(
        self, store, double padding, bint resident, int64_t kept=0, bint direct=False,
        bint plain=False,
    ):
        self.padding, self.resident, self.plain = padding, resident, plain
        self.direct = direct and not resident
        self.kept, self.files = [], []
        streams = [stream for stream in store.streams if stream.treelets]
        self.streams = <TreeStream*>PyMem_RawMalloc((len(streams) + 1) * sizeof(TreeStream))
        self.stream_count = len(streams)
        if self.streams == NULL:
            raise MemoryError("a list of streams")
        tables = [np.empty(0, TREELET)]
        numbers = [np.empty(0, np.uint16)]
        for place, stream in enumerate(streams):
            self.open_stream(&self.streams[place], stream, store)
            tables.append(table_of(stream))
            numbers.append(np.full(stream.treelets, place, np.uint16))
        table = self.keep(tables[1] if len(streams) == 1 else np.concatenate(tables))
        tables.clear()  # what is above takes its memory
        self.treelets = len(table)
        self.stream_of = np.concatenate(numbers)
        self.there = np.zeros(self.treelets if resident else 0, np.uint8)
        self.locks = np.zeros(self.treelets if resident else 0, np.uint8)
        self.place = np.zeros(0 if resident else self.treelets, np.int32)
        self.grow_top(table)
        if not resident:
            self.keep_room(kept)

    def __dealloc__(self):
        PyMem_RawFree(self.streams)

    cdef object keep(self, array):
        """Keep an array as long as this is there."""
        self.kept.append(array)
        return array

    cdef int keep_room(self, int64_t room) except -1:
        """Take memory for first nodes and sketches, of fewer nodes where there is less of it."""
        cdef int64_t first_nodes = self.treelets * NODE_BYTES, nodes, sketch_bytes
        if self.treelets and 2 * first_nodes <= room:
            self.roots = <Node*>self.memory_of(first_nodes)
            memset(self.roots, 0, first_nodes)
            room -= first_nodes
        self.top.roots = self.roots
        nodes = room // max(1, self.treelets * DRAWN_BYTES)
        self.drawn = <int>max(<int64_t>FEWEST_DRAWN, min(nodes, <int64_t>MOST_DRAWN))
        sketch_bytes = self.drawn * DRAWN_BYTES
        self.sketch_room = <int32_t>min(room // sketch_bytes, self.treelets)
        self.sketches = self.memory_of(max(<int64_t>1, self.sketch_room * sketch_bytes))
        return 0

    cdef int open_stream(self, TreeStream* s, stream, store) except -1:
        """Open the files of a stream, and take memory for them, of which what is used is given."""
        memset(s, 0, sizeof(TreeStream))
        s.kind, s.counted, s.stride = stream.kind, stream.kind.counted, stream.stride
        s.frame = frame_of(stream.wide, store.origin)
        s.four = four_test(s.kind, stream.wide, self.plain)
        s.number, s.id_bytes = stream.number, stream.id_bytes
        s.node_file, s.record_file = self.opened(stream, "nodes"), self.opened(stream, "geometry")
        s.id_file = self.opened(stream, "ids")
        if s.counted:
            s.end_file = self.opened(stream, "offsets")
            s.box_file = self.opened(stream, "boxes")
        if self.resident:
            s.nodes = <Node*>self.memory_of(stream.files["nodes"].bytes)
            s.records = self.memory_of(stream.files["geometry"].bytes)
            s.ids = self.memory_of(stream.files["ids"].bytes)
            if s.counted:
                s.ends = <uint32_t*>self.memory_of(stream.files["offsets"].bytes)
                s.boxes = <Box*>self.memory_of(stream.files["boxes"].bytes)
        return 0

    cdef void* opened(self, stream, name) except NULL:
        """Open a file of a stream for as long as this is there."""
        file = stream.opened(name, True, self.direct)
        self.files.append(file)
        return <void*>file

    cdef unsigned char* memory_of(self, int64_t n) except NULL:
        """Take n bytes of memory."""
        cdef uint8_t[::1] memory = self.keep(np.empty(n, np.uint8))
        return &memory[0]

    cdef int grow_top(self, table) except -1:
        """Build the tree above the treelets."""
        cdef const uint8_t[::1] raw
        cdef const uint32_t[::1] leaves
        cdef Top* top = &self.top
        cdef int64_t k
        top.padding, top.spans, top.count = self.padding, spans_of(self.plain), self.treelets
        box_clear(&top.around)
        if not self.treelets:
            return 0
        raw = table.view(np.uint8)
        self.treelet = <const Treelet*>&raw[0]
        top.boxes, top.stride = &raw[0], sizeof(Treelet)
        for k in range(self.treelets):
            box_add(&top.around, <const Box*>(self.treelet + k))
        # A sight around all treelets is off by 2^-21 of their extent, and objects are some 2^-5 of
        # their treelet's: down to 2^-10 of all a treelet is seen well enough from there.
        top.small = extent_of(&top.around) / 1024
        boxes = table.view(np.float32).reshape(self.treelets, -1)[:, :6]
        nodes, _, order = TreeletBuilder(self.treelets, 1).build(boxes)
        raw = self.keep(nodes.copy().view(np.uint8))
        top.nodes = <const Node*>&raw[0]
        leaves = self.keep(order.copy())
        top.leaves = &leaves[0]
        return 0

    @staticmethod
    def bytes(store):
        """Return the bytes of the tree above, with the table of treelets."""
        return TREELET_SHARE * sum(stream.treelets for stream in store.streams)

    @staticmethod
    def resident_bytes(store):
        """Return the bytes of all treelets."""
        return sum(
            stream.files[name].bytes
            for stream in store.streams for name in PARTS if name in stream.files
        )

    @staticmethod
    def kept_bytes(store):
        """Return the bytes of all first nodes and sketches, kept where treelets stream."""
        each = NODE_BYTES + MOST_DRAWN * DRAWN_BYTES
        return each * sum(stream.treelets for stream in store.streams)

    def counts(self):
        """Return the bytes read, the seeks and the treelets read since the last call."""
        counts = [file.counts() for file in self.files]
        read = atomic_exchange(&self.treelets_read, 0)
        return sum(count[0] for count in counts), sum(count[1] for count in counts), read

    def load_part(self, uint32_t first, uint32_t end):
        """Read the treelets in [first, end) of a resident forest, in order; any thread may."""
        cdef uint32_t k = first, last
        with nogil:
            while k < end:
                last = k
                while last < end and self.stream_of[last] == self.stream_of[k]:
                    last += 1
                self.load(k, last)
                k = last

    cdef int load(self, uint32_t first, uint32_t end) except -1 nogil:
        """Read treelets [first, end) of one stream to their places."""
        cdef const TreeStream* s = stream_at(self, first)
        cdef const Treelet* a = treelet_at(self, first)
        cdef const Treelet* b = treelet_at(self, end - 1)
        cdef int64_t nodes = <int64_t>(b.node + b.nodes - a.node)
        cdef int64_t begin = <int64_t>a.first, count = <int64_t>(b.first + b.count - a.first)
        cdef int64_t record = begin, records = count
        cdef const Treelet* t
        cdef uint32_t k
        read_at(
            <SharedFile>s.node_file, s.nodes + a.node, nodes * NODE_BYTES, a.node * NODE_BYTES
        )
        for k in range(first, end):
            t = treelet_at(self, k)
            check_nodes(s.nodes + t.node, t.nodes, t.count, <SharedFile>s.node_file)
        if s.counted:
            record = 0
            if begin:
                read_at(<SharedFile>s.end_file, s.ends + begin - 1, OFFSET_BYTES,
                        (begin - 1) * OFFSET_BYTES)
                record = s.ends[begin - 1]
            read_at(<SharedFile>s.end_file, s.ends + begin, count * OFFSET_BYTES,
                    begin * OFFSET_BYTES)
            check_ends(s.ends + begin, count, <uint32_t>record,
                       (<SharedFile>s.record_file).size // s.stride, <SharedFile>s.end_file)
            records = s.ends[begin + count - 1] - record
            read_at(<SharedFile>s.box_file, s.boxes + begin, count * BOX_BYTES, begin * BOX_BYTES)
        read_at(<SharedFile>s.record_file, s.records + record * s.stride, records * s.stride,
                record * s.stride)
        read_at(<SharedFile>s.id_file, s.ids + begin * s.id_bytes, count * s.id_bytes,
                begin * s.id_bytes)
        atomic_add(&self.treelets_read, end - first)
        for k in range(first, end):
            publish(&self.there[k])
        return 0

    cdef int fetch(self, uint32_t treelet) except -1 nogil:
        """Read a treelet to its place, unless another thread has by now."""
        lock(&self.locks[treelet])
        try:
            if not published(&self.there[treelet]):
                self.load(treelet, treelet + 1)
        finally:
            unlock(&self.locks[treelet])
        return 0

    cdef void resident_piece(self, uint32_t treelet, Piece* p) noexcept nogil:
        """Set a piece to a treelet that is in memory."""
        cdef const Treelet* t = treelet_at(self, treelet)
        cdef const TreeStream* s = stream_at(self, treelet)
        p.kind, p.stride, p.frame = s.kind, s.stride, s.frame
        p.four, p.box, p.nodes = s.four, <const Box*>t, s.nodes + t.node
        p.first, p.objects = s.number << INDEX_BITS | t.first, <uint32_t>t.count
        p.begins, p.boxes, p.ends, p.begin, p.skipped = NULL, NULL, NULL, 0, 0
        p.records = s.records
        if s.counted:
            p.boxes, p.ends = s.boxes + t.first, s.ends + t.first
            p.begin = s.ends[t.first - 1] if t.first > 0 else 0
            p.records += p.begin * s.stride
        else:
            p.records += t.first * s.stride
