"""The treelets of a store."""

cimport cython
from cpython.mem cimport PyMem_RawFree, PyMem_RawMalloc
from libc.stdint cimport int64_t, uint8_t, uint16_t, uint32_t, uint64_t

import numpy as np

from bfrt.geometry.box cimport Box
from bfrt.geometry.coordinates cimport frame_of
from bfrt.records cimport INDEX_BITS, NODE_BYTES, Treelet
from bfrt.streams.reader cimport SharedFile
from bfrt.tree.walk cimport Piece
from bfrt.treelets.node cimport Node, node_spanner

from bfrt.records import NODE, TREELET
from bfrt.treelets.build import TreeletBuilder


@cython.final
cdef class Forest:
    """Holds the tree above the treelets of a store, and all of them where memory has room.

    Parameters
    ----------
    store : bfrt.store.store.Store
        All of whose streams are in spatial order.
    padding : float
        d, by which boxes are padded (docs/algorithm.rst, Exactness).
    resident : bool
        Whether nodes and geometry are read now, and stay.
    plain : bool
        Whether boxes are tested without wide vectors; it changes no answer.

    Attributes
    ----------
    treelets : int
        Number of treelets.
    """

    def __cinit__(self, store, double padding, bint resident, bint plain=False):
        cdef const uint8_t[::1] raw
        cdef const uint32_t[::1] leaves
        cdef const float[:, ::1] boxes
        cdef TreeStream* s
        self.padding, self.resident = padding, resident
        self.kept, self.files = [], []
        streams = [stream for stream in store.streams if stream.treelets]
        self.streams = <TreeStream*>PyMem_RawMalloc((len(streams) + 1) * sizeof(TreeStream))
        if self.streams == NULL:
            raise MemoryError("streams")
        tables = [np.empty(0, TREELET)]
        numbers = [np.empty(0, np.uint16)]
        for place, stream in enumerate(streams):
            s = &self.streams[place]
            s.kind, s.counted, s.stride = stream.kind, stream.kind.counted, stream.stride
            s.frame = frame_of(stream.wide, store.origin)
            s.number = stream.number
            s.nodes = s.records = NULL
            s.ends = NULL
            tables.append(np.fromfile(stream.path("treelets"), TREELET))
            numbers.append(np.full(stream.treelets, place, np.uint16))
            if resident:
                raw = self.keep(np.fromfile(stream.path("nodes"), np.uint8))
                s.nodes = &raw[0]
                raw = self.keep(np.fromfile(stream.path("geometry"), np.uint8))
                s.records = &raw[0]
                if s.counted:
                    raw = self.keep(np.fromfile(stream.path("offsets"), np.uint8))
                    s.ends = <const uint32_t*>&raw[0]
            s.node_file = self.opened(stream, "nodes")
            s.geometry_file = self.opened(stream, "geometry")
            s.offset_file = self.opened(stream, "offsets") if s.counted else NULL
        table = self.keep(np.concatenate(tables))
        self.stream_of = self.keep(np.concatenate(numbers))
        self.treelets = len(table)
        sides = [table[name] for name in ("lox", "loy", "loz", "hix", "hiy", "hiz")]
        boxes = self.keep(np.ascontiguousarray(np.stack(sides, 1)))
        nodes, _, order = TreeletBuilder(max(1, self.treelets), 1).build(boxes)
        self.top.padding, self.top.spans = padding, node_spanner(plain)
        self.top.count = self.treelets
        if self.treelets:
            raw = self.keep(table.view(np.uint8))
            self.treelet = <const Treelet*>&raw[0]
            raw = self.keep(nodes.copy().view(np.uint8))
            self.top.nodes = <const Node*>&raw[0]
            leaves = self.keep(order.copy())
            self.top.leaves = &leaves[0]
            self.top.boxes = <const Box*>&boxes[0, 0]

    def __dealloc__(self):
        PyMem_RawFree(self.streams)

    cdef void* opened(self, stream, name) except NULL:
        """Open a file of a stream for as long as this is there."""
        file = SharedFile(stream.path(name), True)
        self.files.append(file)
        return <void*>file

    def counts(self):
        """Return the bytes read and the seeks since the last call, as a pair."""
        counts = [file.counts() for file in self.files]
        return sum(count[0] for count in counts), sum(count[1] for count in counts)

    cdef object keep(self, array):
        """Keep an array as long as this is there."""
        self.kept.append(array)
        return array

    @staticmethod
    def bytes(store):
        """Return the bytes of the tree above, with the table of treelets."""
        treelets = sum(stream.treelets for stream in store.streams)
        return treelets * (3 * TREELET.itemsize + NODE.itemsize + 16)

    @staticmethod
    def resident_bytes(store):
        """Return the bytes of all nodes and geometry."""
        names = "nodes", "geometry", "offsets"
        return sum(
            stream.files[name].bytes
            for stream in store.streams for name in names if name in stream.files
        )

    cdef void resident_piece(self, uint32_t treelet, Piece* p) noexcept nogil:
        """Set a piece to a treelet that is in memory."""
        cdef const Treelet* t = &self.treelet[treelet]
        cdef const TreeStream* s = &self.streams[self.stream_of[treelet]]
        p.kind, p.stride, p.frame = s.kind, s.stride, s.frame
        p.nodes = <const Node*>(s.nodes + t.node * NODE_BYTES)
        p.first = s.number << INDEX_BITS | t.first
        p.ends, p.begin = NULL, 0
        p.records = s.records
        if s.counted:
            p.ends = s.ends + t.first
            p.begin = s.ends[t.first - 1] if t.first > 0 else 0
            p.records += p.begin * s.stride
        else:
            p.records += t.first * s.stride
