"""Walks of one ray down a resident forest: treelets by entry, each to its end, nearest first."""

from libc.stdint cimport uint32_t

from bfrt.bits cimport lowest_bit, ones
from bfrt.tree.forest cimport Forest, want
from bfrt.tree.top cimport Top
from bfrt.tree.walk cimport WAITING, Piece, Search, walk_treelet
from bfrt.treelets.node cimport INNER, Node

cdef enum:
    TREELET = 0x80000000  # what waits is a treelet, not a node

# Nodes of the tree above and treelets that wait, the nearest on top.
cdef struct Waiting:
    uint32_t what[WAITING]
    float entry[WAITING]
    int n


cdef inline void keep_waiting(Waiting* w, int base, float entry, uint32_t what) noexcept nogil:
    """Add what waits, in its place among those added since there were `base`."""
    cdef int k = w.n
    while k > base and w.entry[k - 1] < entry:
        w.entry[k], w.what[k] = w.entry[k - 1], w.what[k - 1]
        k -= 1
    w.entry[k], w.what[k] = entry, what
    w.n += 1


cdef inline void keep_children(const Top* top, const Node* node, unsigned int met,
                               const float* near, Waiting* w) noexcept nogil:
    """Add the children of a node of the tree above: each leaf is one treelet."""
    cdef int base = w.n, c
    cdef unsigned int below, leaf
    while met:
        c = lowest_bit(met)
        met &= met - 1
        below = (1 << c) - 1
        if node.count[c] == INNER:
            keep_waiting(w, base, near[c], node.child + <uint32_t>ones(node.inner & below))
        else:
            leaf = node.first + <uint32_t>(c - ones(node.inner & below))
            keep_waiting(w, base, near[c], TREELET | top.leaves[leaf])


cdef inline int descend(Forest f, Search* s) except -1 nogil:
    """Test a ray against all objects that it may meet, of a resident forest."""
    cdef const Top* top = &f.top
    cdef const Node* node = top.nodes
    cdef float near[8]
    cdef Waiting w
    cdef Piece p
    cdef uint32_t what
    w.n = 0
    if top.count == 0:
        return 0
    while True:
        s.node_tests += 1
        keep_children(top, node, s.spans(node, &s.slope, s.reach, near), near, &w)
        while True:
            while w.n > 0 and w.entry[w.n - 1] > s.reach:
                w.n -= 1
            if w.n == 0:
                return 0
            w.n -= 1
            what = w.what[w.n]
            if not what & TREELET:
                break
            want(f, what ^ TREELET)
            f.resident_piece(what ^ TREELET, &p)
            walk_treelet(&p, s)
        node = top.nodes + what
