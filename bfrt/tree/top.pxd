"""The top tree: which treelets a ray enters, front to back.

A ray's walk has a state of two numbers, the t at which it enters a treelet's box and that treelet's
number: its next candidates are those that come no earlier in that order, so nothing else is kept
from pass to pass (the paper's sentinel, exactness rule 7).
"""

from libc.stdint cimport int64_t, uint32_t

from bfrt.bits cimport lowest_bit, ones_of_eight
from bfrt.geometry.box cimport Box, Span, box_span
from bfrt.geometry.vector cimport Line
from bfrt.tree.sight cimport Heading, Sight, Spans, heading_of, sight_of, sight_reach
from bfrt.tree.walk cimport Waiting, next_waiting, wait_inner
from bfrt.treelets.node cimport Node

cdef enum:
    MOST_CANDIDATES = 64  # of a ray in a pass, the sentinel included

# The tree above treelets: `leaves` are their numbers in the order of its nodes' leaves.
cdef struct Top:
    const Node* nodes
    Box around      # all treelets
    float small     # the extent of a treelet that needs a sight of its own
    const uint32_t* leaves
    const unsigned char* boxes      # of the treelets, by number, so many bytes apart
    size_t stride
    int64_t count
    const Node* roots   # the first node of each treelet that has been read, or NULL
    double padding      # d, by which objects' boxes are padded
    Spans spans

# A treelet that a ray enters.
cdef struct Entry:
    double t
    uint32_t treelet


cdef inline float extent_of(const Box* b) noexcept nogil:
    """Return the largest side of a box."""
    return max(b.hi[0] - b.lo[0], max(b.hi[1] - b.lo[1], b.hi[2] - b.lo[2]))


cdef inline uint32_t leaf_before(const Node* node, int c) noexcept nogil:
    """Return which leaf child c of a node is, of leaves of one treelet each."""
    return node.first + <uint32_t>(c - ones_of_eight(node.inner & ((1 << c) - 1)))


cdef inline bint comes_before(const Entry* one, const Entry* other) noexcept nogil:
    return one.t < other.t or (one.t == other.t and one.treelet < other.treelet)


cdef inline bint entry_of(const Top* top, const Line* l, uint32_t treelet, Entry* e) noexcept nogil:
    """Find where a ray enters a treelet's box; false for nowhere."""
    cdef Span span
    if not box_span(<const Box*>(top.boxes + treelet * top.stride), top.padding, l, &span):
        return False
    e.t, e.treelet = span.near, treelet
    return True


cdef inline int keep_entry(Entry* found, int n, int most, const Entry* e) noexcept nogil:
    """Insert an entry among n ascending ones, of which `most` are kept; return how many there are.
    """
    cdef int k
    if n == most:
        if not comes_before(e, &found[most - 1]):
            return n
        n -= 1
    k = n
    while k > 0 and comes_before(e, &found[k - 1]):
        found[k] = found[k - 1]
        k -= 1
    found[k] = e[0]
    return n + 1


# A ray's look for treelets: the first that counts, the last t that does, and how many are kept.
cdef struct Look:
    Entry first
    double reach
    int most
    int64_t node_tests


cdef inline bint passes_by(const Top* top, const Heading* heading, uint32_t treelet,
                           Look* look) noexcept nogil:
    """Tell whether a ray enters no child of a treelet's first node, where that is known."""
    cdef const Node* root
    cdef float near[8]
    cdef Sight sight
    if top.roots == NULL:
        return False
    root = &top.roots[treelet]
    if root.child == 0:
        return False
    look.node_tests += 1
    sight = sight_of(heading, <const Box*>(top.boxes + treelet * top.stride))
    return not top.spans(root, &sight, sight_reach(&sight, look.reach), near)


cdef inline int next_treelets(const Top* top, const Line* l, Look* look,
                              Entry* found) noexcept nogil:
    """Find the next treelets that a ray enters, ascending; return how many."""
    cdef Heading heading = heading_of(l, top.padding)
    cdef Sight sight
    cdef Waiting w
    cdef float near[8]
    cdef const Node* node
    cdef Entry e
    cdef float limit
    cdef uint32_t what = 0
    cdef int count = 0, c
    cdef unsigned int met, leaves
    w.n = 0
    if top.count == 0:
        return 0
    sight = sight_of(&heading, &top.around)
    limit = sight_reach(&sight, look.reach)
    while True:
        look.node_tests += 1
        node = top.nodes + what
        met = top.spans(node, &sight, limit, near)
        leaves = met & ~<unsigned int>node.inner
        while leaves:
            c = lowest_bit(leaves)
            leaves &= leaves - 1
            if entry_of(top, l, top.leaves[leaf_before(node, c)], &e) and e.t <= look.reach:
                if not comes_before(&e, &look.first) and not passes_by(
                    top, &heading, e.treelet, look
                ):
                    count = keep_entry(found, count, look.most, &e)
                    if count == look.most:
                        limit = sight_reach(&sight, found[count - 1].t)
        wait_inner(top.nodes, what, met, near, &w)
        if not next_waiting(&w, limit, &what):
            return count
