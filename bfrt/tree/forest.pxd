"""The treelets of a store: the tree above them, which is always in memory, and where each is."""

from libc.stdint cimport int32_t, int64_t, uint8_t, uint16_t, uint32_t, uint64_t
from libc.string cimport memcpy

from bfrt.geometry.box cimport Box
from bfrt.geometry.coordinates cimport Frame
from bfrt.geometry.four cimport FourTest
from bfrt.phases.pending cimport prefetch
from bfrt.records cimport INDEX_BITS, NO_HIT, Treelet
from bfrt.streams.atomic cimport atomic_fetch_add, published
from bfrt.tree.sketch cimport DRAWN_BYTES, MOST_DRAWN, Begins, draw
from bfrt.tree.top cimport Top
from bfrt.tree.walk cimport Piece
from bfrt.treelets.node cimport Node

cdef enum:
    UNDRAWN = -1

# A stream as its treelets need it; where treelets are read one after another, there are files only.
cdef struct TreeStream:
    int kind
    bint counted
    size_t stride
    Frame frame
    uint64_t number
    int id_bytes
    FourTest four
    Node* nodes
    unsigned char* records
    Box* boxes              # these two NULL where each object has one record
    uint32_t* ends
    unsigned char* ids
    void* node_file         # SharedFiles
    void* record_file
    void* box_file
    void* end_file
    void* id_file


cdef class Forest:
    cdef readonly int64_t treelets
    cdef readonly double padding
    cdef readonly bint resident
    cdef readonly bint plain
    cdef readonly bint direct
    cdef Top top
    cdef const Treelet* treelet
    cdef const uint16_t[::1] stream_of  # of each treelet, by its place in `streams`
    cdef TreeStream* streams
    cdef int stream_count
    cdef uint8_t[::1] there     # of each treelet, whether it is in memory
    cdef uint8_t[::1] locks
    cdef int32_t[::1] place     # of each treelet's sketch, from 1; 0 for none, UNDRAWN for never
    cdef unsigned char* sketches
    cdef int drawn              # nodes of a sketch at the most
    cdef int32_t sketch_room    # for how many there is room
    cdef int64_t sketched
    cdef Node* roots    # the first node of each treelet that has been read
    cdef int64_t treelets_read
    cdef list kept      # what the pointers point into
    cdef list files

    cdef object keep(self, array)
    cdef int keep_room(self, int64_t room) except -1
    cdef int open_stream(self, TreeStream* s, stream, store) except -1
    cdef int grow_top(self, table) except -1
    cdef void* opened(self, stream, name) except NULL
    cdef unsigned char* memory_of(self, int64_t n) except NULL
    cdef int load(self, uint32_t first, uint32_t end) except -1 nogil
    cdef int fetch(self, uint32_t treelet) except -1 nogil
    cdef void resident_piece(self, uint32_t treelet, Piece* p) noexcept nogil


cdef inline const Treelet* treelet_at(Forest f, uint32_t treelet) noexcept nogil:
    return f.treelet + treelet


cdef inline const TreeStream* stream_at(Forest f, uint32_t treelet) noexcept nogil:
    """Return the stream of a treelet."""
    return &f.streams[f.stream_of[treelet]]


cdef inline int want(Forest f, uint32_t treelet) except -1 nogil:
    """See that a treelet of a resident forest is in memory."""
    if not published(&f.there[treelet]):
        f.fetch(treelet)
    return 0


cdef inline const TreeStream* stream_numbered(Forest f, uint64_t number) noexcept nogil:
    """Return the stream of that number, which there is."""
    cdef const TreeStream* s = f.streams
    while s.number != number:
        s += 1
    return s


cdef inline void prefetch_id(Forest f, uint64_t id) noexcept nogil:
    """Have the place that an object was given at come from memory, if it is an object's here.

    A ray may come with no hit, or with one on an object of another forest.
    """
    cdef uint64_t number = id >> INDEX_BITS
    cdef const TreeStream* s
    cdef int k
    if id == NO_HIT:
        return
    for k in range(f.stream_count):
        s = &f.streams[k]
        if s.number == number:
            prefetch(s.ids + (id & ((<uint64_t>1 << INDEX_BITS) - 1)) * s.id_bytes)
            return


cdef inline Node* sketch_at(Forest f, int64_t place) noexcept nogil:
    """Return the nodes of a sketch, whose begins follow."""
    return <Node*>(f.sketches + (place - 1) * f.drawn * DRAWN_BYTES)


cdef inline const Begins* begins_at(Forest f, const Node* sketch) noexcept nogil:
    """Return where the leaves of a sketch begin."""
    return <const Begins*>(sketch + f.drawn)


cdef inline const Node* sketch_of(Forest f, uint32_t treelet) noexcept nogil:
    """Return the sketch of a treelet that streams, if there is one."""
    return sketch_at(f, f.place[treelet]) if f.place[treelet] > 0 else NULL


cdef inline void sketch(Forest f, uint32_t treelet, const Node* nodes) noexcept nogil:
    """Draw a treelet whose nodes have been read, if there is room, and keep the first anyway.

    In a pass one thread has a treelet, others in the next.
    """
    cdef const Treelet* t = treelet_at(f, treelet)
    cdef Node drawn[MOST_DRAWN]
    cdef Begins begins[MOST_DRAWN]
    cdef Node* kept
    cdef int64_t place
    if f.roots != NULL:
        f.roots[treelet] = nodes[0]
    if f.place[treelet] == UNDRAWN or f.sketched >= f.sketch_room:
        return
    if not draw(nodes, t.nodes, t.count, f.drawn, drawn, begins):
        f.place[treelet] = UNDRAWN
        return
    place = atomic_fetch_add(&f.sketched, 1) + 1
    if place <= f.sketch_room:
        kept = sketch_at(f, place)
        memcpy(kept, drawn, f.drawn * sizeof(Node))
        memcpy(kept + f.drawn, begins, f.drawn * sizeof(Begins))
        f.place[treelet] = <int32_t>place
