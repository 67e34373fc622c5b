"""Walks down a resident forest: treelets by entry, each to its end, nearest first.

::

    ABOVE ──► ENTER ──► BELOW ◄──► LEAVES        what a ray looks at next, of which memory is told
      ▲                   │          │           a step ahead: it comes while other rays take theirs
      └───────────────────┴──────────┘

Several rays go down in turn, a step each, for most steps wait for memory.
"""

from libc.stdint cimport int64_t, uint32_t

from bfrt.bits cimport lowest_bit, ones_of_eight
from bfrt.tree.forest cimport Forest, prefetch_id, treelet_at, want
from bfrt.tree.sight cimport Sight, prefetch_node, sight_of, sight_reach
from bfrt.tree.top cimport Top, extent_of, leaf_before
from bfrt.tree.walk cimport (
    Piece, Search, Waiting, meet_leaves, next_waiting, prefetch_leaves, wait_among, wait_inner,
)
from bfrt.treelets.node cimport INNER, Node

cdef enum:
    TREELET = 0x80000000    # what waits is a treelet, not a node
    ABREAST = 4              # rays that go down in turn

cdef enum:
    ABOVE = 0       # a node of the tree above
    ENTER = 1       # a treelet
    BELOW = 2       # a node of it
    LEAVES = 3      # those of the node's children that are leaves, and met
    ARRIVED = 4

# A ray on its way down.
cdef struct Descent:
    Search search
    int64_t row     # which ray, for whoever takes what it finds
    int stage
    uint32_t what   # node or treelet
    unsigned int leaves
    Sight above
    Sight near      # of a treelet that is small
    bint small
    float reach     # as seen below
    Waiting waiting_above
    Waiting waiting
    Piece piece

# Sets up the next ray; false where there are no more. Takes what a ray has found.
ctypedef bint (*NextRay)(void* source, Descent* d) noexcept nogil
ctypedef void (*TakeRay)(void* source, const Descent* d) noexcept nogil

# Where rays come from, and go to.
cdef struct Source:
    void* source
    NextRay next
    TakeRay take


cdef inline void set_out(Forest f, Descent* d) noexcept nogil:
    """Begin the way down of a search that is set up."""
    d.waiting_above.n = 0
    d.what = 0
    d.stage = ABOVE if f.top.count else ARRIVED
    d.above = sight_of(&d.search.heading, &f.top.around)


cdef inline void wait_children(const Top* top, const Node* node, unsigned int met,
                               const float* near, Waiting* w) noexcept nogil:
    """Add the children of a node of the tree above: each leaf is one treelet."""
    cdef int base = w.n, c
    cdef unsigned int below
    cdef uint32_t child
    while met:
        c = lowest_bit(met)
        met &= met - 1
        below = (1 << c) - 1
        if node.count[c] == INNER:
            child = node.child + <uint32_t>ones_of_eight(node.inner & below)
            prefetch_node(top.nodes + child)
            wait_among(w, base, near[c], child)
        else:
            wait_among(w, base, near[c], TREELET | top.leaves[leaf_before(node, c)])


cdef inline void go_on_above(Forest f, Descent* d) noexcept nogil:
    """Come to the nearest that waits of the tree above."""
    cdef float reach = sight_reach(&d.above, d.search.t)
    if not next_waiting(&d.waiting_above, reach, &d.what):
        d.stage = ARRIVED
        prefetch_id(f, d.search.id)
    elif d.what & TREELET:
        d.what ^= TREELET
        prefetch_node(<const Node*>treelet_at(f, d.what))
        d.stage = ENTER
    else:
        d.stage = ABOVE


cdef inline void go_on(Forest f, Descent* d) noexcept nogil:
    """Come to the nearest node that waits, or else of the tree above."""
    if next_waiting(&d.waiting, d.reach, &d.what):
        d.stage = BELOW
    else:
        go_on_above(f, d)


cdef inline const Sight* below(const Descent* d) noexcept nogil:
    """Return the ray as the nodes of its treelet see it."""
    return &d.near if d.small else &d.above


cdef inline int enter(Forest f, Descent* d) except -1 nogil:
    """Come into a treelet."""
    want(f, d.what)
    f.resident_piece(d.what, &d.piece)
    prefetch_node(d.piece.nodes)
    d.small = extent_of(d.piece.box) < f.top.small
    if d.small:
        d.near = sight_of(&d.search.heading, d.piece.box)
    d.reach = sight_reach(below(d), d.search.t)
    d.waiting.n = 0
    d.what = 0
    d.stage = BELOW
    return 0


cdef inline void look_above(Forest f, Descent* d) noexcept nogil:
    """Look at a node of the tree above."""
    cdef const Node* node = f.top.nodes + d.what
    cdef float near[8]
    cdef unsigned int met = d.search.spans(
        node, &d.above, sight_reach(&d.above, d.search.t), near
    )
    d.search.node_tests += 1
    wait_children(&f.top, node, met, near, &d.waiting_above)
    go_on_above(f, d)


cdef inline void look_below(Forest f, Descent* d) noexcept nogil:
    """Look at a node of a treelet."""
    cdef const Node* node = d.piece.nodes + d.what
    cdef float near[8]
    cdef unsigned int met = d.search.spans(node, below(d), d.reach, near)
    d.search.node_tests += 1
    wait_inner(d.piece.nodes, d.what, met, near, &d.waiting)
    d.leaves = met & ~<unsigned int>node.inner
    if d.leaves:
        prefetch_leaves(&d.piece, d.what, d.leaves)
        d.stage = LEAVES
    else:
        go_on(f, d)


cdef inline int step(Forest f, Descent* d) except -1 nogil:
    """Take a step down, to where memory has to come from afar."""
    if d.stage == BELOW:
        look_below(f, d)
    elif d.stage == LEAVES:
        meet_leaves(&d.piece, d.what, d.leaves, &d.search)
        d.reach = sight_reach(below(d), d.search.t)
        go_on(f, d)
    while d.stage == ABOVE:
        look_above(f, d)
    if d.stage == ENTER:
        enter(f, d)
    return 0


cdef inline void swap(Descent* one, Descent* other) noexcept nogil:
    cdef Descent held = one[0]
    one[0] = other[0]
    other[0] = held


cdef inline int descend_all(Forest f, Descent* abreast, const Source* source) except -1 nogil:
    """Test rays against all objects that they may meet, of a resident forest."""
    cdef int n = 0, k
    while n < ABREAST and source.next(source.source, &abreast[n]):
        set_out(f, &abreast[n])
        n += 1
    while n:
        k = 0
        while k < n:
            if abreast[k].stage != ARRIVED:
                step(f, &abreast[k])
                k += 1
                continue
            source.take(source.source, &abreast[k])
            if source.next(source.source, &abreast[k]):
                set_out(f, &abreast[k])
                k += 1
            else:
                n -= 1
                swap(&abreast[k], &abreast[n])
    return 0


cdef inline object count_tests(Descent* abreast):
    """Return the nodes and the objects tested since the last call."""
    cdef int64_t nodes = 0, objects = 0
    cdef int k
    for k in range(ABREAST):
        nodes += abreast[k].search.node_tests
        objects += abreast[k].search.object_tests
        abreast[k].search.node_tests = abreast[k].search.object_tests = 0
    return nodes, objects
