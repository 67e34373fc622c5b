"""The top tree: which treelets a ray enters, front to back.

A ray's walk has a state of two numbers, the t at which it enters a treelet's box and that treelet's
number: its next candidates are those that come behind it in that order, so nothing else is kept
from pass to pass (the paper's sentinel, exactness rule 7).
"""

from libc.stdint cimport uint32_t, uint64_t

from bfrt.geometry.box cimport Box, Span, above, below, box_span
from bfrt.geometry.vector cimport Line
from bfrt.treelets.node cimport INNER, WIDE, Node, NodeSpan, Slope
from bfrt.tree.walk cimport WAITING, bits_of, lowest_bit

cdef enum:
    MOST_CANDIDATES = 64  # of a ray in a pass, the sentinel included

cdef extern from *:
    """
    enum { BFRT_NO_TREELET = 0xffffffff };
    """
    const uint32_t NO_TREELET "(uint32_t)BFRT_NO_TREELET"

# The tree above treelets: `leaves` are their numbers in the order of its nodes' leaves.
cdef struct Top:
    const Node* nodes
    const uint32_t* leaves
    const Box* boxes    # by number
    double grow         # d, by which objects' boxes are grown
    NodeSpan spans

# A treelet that a ray enters.
cdef struct Entry:
    double t
    uint32_t treelet


cdef inline bint comes_before(double t, uint32_t treelet, const Entry* other) noexcept nogil:
    return t < other.t or (t == other.t and treelet < other.treelet)


cdef inline bint entry_of(const Top* top, const Line* l, uint32_t treelet, Entry* e) noexcept nogil:
    """Find where a ray enters a treelet's box; false for nowhere."""
    cdef Span span
    if not box_span(&top.boxes[treelet], top.grow, l, &span):
        return False
    e.t, e.treelet = span.near, treelet
    return True


cdef inline void keep_entry(Entry* found, int* n, int most, const Entry* e) noexcept nogil:
    """Insert an entry among up to `most` ascending ones; the last falls out."""
    cdef int k
    if n[0] == most:
        if not comes_before(e.t, e.treelet, &found[most - 1]):
            return
        n[0] -= 1
    k = n[0]
    while k > 0 and comes_before(e.t, e.treelet, &found[k - 1]):
        found[k] = found[k - 1]
        k -= 1
    found[k] = e[0]
    n[0] += 1


cdef inline int next_treelets(const Top* top, const Line* l, const Slope* slope, const Entry* last,
                              double reach, int most, Entry* found,
                              uint64_t* node_tests) noexcept nogil:
    """Find the next treelets that a ray enters behind `last`, and no later than at `reach`.

    Parameters
    ----------
    last : Entry
        The last treelet that it has been through; a t below 0 for none.
    most : int
        As many are found, up to MOST_CANDIDATES, if there are.
    found : Entry[most]
        OUT. Ascending.

    Returns
    -------
    int
        How many are found.
    """
    cdef uint32_t waiting[WAITING]
    cdef float entry[WAITING]
    cdef float near[8]
    cdef const Node* node
    cdef Entry e
    cdef uint32_t number = 0, leaf
    cdef float limit = above(reach), t
    cdef int n = 0, count = 0, c, k
    cdef unsigned int met
    while True:
        node = top.nodes + number
        node_tests[0] += 1
        met = top.spans(node, slope, limit, near)
        leaf = node.first
        for c in range(WIDE):
            if node.count[c] == INNER or node.count[c] == 0:
                continue
            if met >> c & 1 and entry_of(top, l, top.leaves[leaf], &e) and e.t <= reach:
                if comes_before(last.t, last.treelet, &e):
                    keep_entry(found, &count, most, &e)
                    if count == most and found[most - 1].t < reach:
                        limit = above(found[most - 1].t)
            leaf += node.count[c]
        met &= node.inner
        while met:
            c = lowest_bit(met)
            met &= met - 1
            t = near[c]
            if t > limit:
                continue
            k = n
            while k > 0 and entry[k - 1] < t:  # farthest at the bottom
                entry[k], waiting[k] = entry[k - 1], waiting[k - 1]
                k -= 1
            entry[k] = t
            waiting[k] = node.child + bits_of(node.inner & ((1 << c) - 1))
            n += 1
        while True:
            if n == 0:
                return count
            n -= 1
            if entry[n] <= limit:
                break
        number = waiting[n]
