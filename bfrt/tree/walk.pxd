"""Walks of one ray down a treelet: nodes by entry, exact tests at the leaves.

The order is that of entry, nearest first, so that hits soon end the walk; it changes no answer.
"""

from libc.stdint cimport uint32_t, uint64_t

from bfrt.geometry.box cimport Box, Span, above, box_span
from bfrt.geometry.coordinates cimport Frame
from bfrt.geometry.shape cimport BoxHit, Shape, shape_bounds, shape_load, shape_meet
from bfrt.geometry.triangle cimport Triangle, triangle_bounds, triangle_hit, triangle_load
from bfrt.geometry.vector cimport Line
from bfrt.records cimport TRIANGLE
from bfrt.treelets.node cimport INNER, WIDE, Node, NodeSpan, Slope

cdef enum:
    WAITING = 7 * (32 + 16)  # nodes of a walk: seven a level; DEEPEST of _build.pyx, and halves

# The geometry of a treelet, with what its records are.
cdef struct Piece:
    int kind
    size_t stride
    const unsigned char* records
    const Node* nodes
    Frame frame

# A ray on its way down: its line, as nodes see it, and the nearest hit so far.
cdef struct Search:
    Line line
    Slope slope
    NodeSpan spans
    double t
    float reach     # t, rounded up
    uint64_t place  # of the object hit
    uint64_t node_tests
    uint64_t object_tests


cdef extern from *:
    """
    static inline int bfrt_lowest_bit(unsigned bits) { return __builtin_ctz(bits); }
    static inline int bfrt_bits(unsigned bits) { return __builtin_popcount(bits); }
    """
    int lowest_bit "bfrt_lowest_bit"(unsigned int bits) noexcept nogil
    int bits_of "bfrt_bits"(unsigned int bits) noexcept nogil


cdef inline bint object_hit(const Piece* p, uint32_t i, const Search* s, double* t) noexcept nogil:
    """Test one object: whether the ray hits it, and no later than its hit so far."""
    cdef Shape shape
    cdef BoxHit m
    cdef Box box
    if not shape_load(p.kind, p.records + i * p.stride, 0, &p.frame, &shape):
        return False
    shape_bounds(&shape, &box)
    if not box_span(&box, s.slope.grow, &s.line, &m.span) or m.span.near > s.t:
        return False
    m.line = s.line
    shape_meet(&shape, &m, 1)
    t[0] = m.t
    return 0.0 <= m.t <= s.t


cdef inline void walk_treelet(const Piece* p, uint64_t first, Search* s) noexcept nogil:
    """Find the nearest hit of a ray in a treelet, whose first object has this place."""
    cdef uint32_t waiting[WAITING]
    cdef float entry[WAITING]
    cdef float near[8]
    cdef const Node* node
    cdef uint32_t leaf, i, number = 0
    cdef unsigned int met
    cdef int n = 0, c, k
    cdef float e = 0.0
    cdef double t
    while True:
        node = p.nodes + number
        s.node_tests += 1
        met = s.spans(node, &s.slope, s.reach, near)
        # leaves first: what they hit may spare the nodes
        leaf = node.first
        for c in range(WIDE):
            if node.count[c] == INNER or node.count[c] == 0:
                continue
            if met >> c & 1 and near[c] <= s.reach:
                for i in range(leaf, leaf + node.count[c]):
                    s.object_tests += 1
                    if object_hit(p, i, s, &t):
                        if t < s.t or first + i < s.place:
                            s.t, s.place = t, first + i
                            s.reach = above(t)
            leaf += node.count[c]
        met &= node.inner
        while met:
            c = lowest_bit(met)
            met &= met - 1
            k = n
            e = near[c]
            if e > s.reach:
                continue
            while k > 0 and entry[k - 1] < e:  # farthest at the bottom
                entry[k], waiting[k] = entry[k - 1], waiting[k - 1]
                k -= 1
            entry[k] = e
            waiting[k] = node.child + bits_of(node.inner & ((1 << c) - 1))
            n += 1
        while True:
            if n == 0:
                return
            n -= 1
            if entry[n] <= s.reach:
                break
        number = waiting[n]
