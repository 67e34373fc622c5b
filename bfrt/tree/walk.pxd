"""Walks of one ray down a treelet: nodes by entry, exact tests at the leaves.

The order is that of entry, nearest first, so that hits soon end the walk; it changes no answer.
"""

from libc.stdint cimport int64_t, uint8_t, uint32_t, uint64_t

from bfrt.bits cimport lowest_bit, ones
from bfrt.geometry.box cimport Box, above, box_span
from bfrt.geometry.coordinates cimport Frame
from bfrt.geometry.outline cimport Shear, shear_along
from bfrt.geometry.shape cimport (
    BoxHit, Shape, shape_bounds, shape_load, shape_meet, shape_missed,
)
from bfrt.geometry.vector cimport Line
from bfrt.phases.crossings cimport CrossingBuffer, cross
from bfrt.records cimport NO_HIT, SHADOW
from bfrt.scan.given_order cimport GivenOrder, comes_first
from bfrt.treelets.node cimport INNER, WIDE, Node, NodeSpan, Slope, slope_of

cdef enum:
    WAITING = 7 * (32 + 16)  # nodes of a walk: seven a level; DEEPEST of the build, and halves

# A treelet's nodes and records. Of objects that have several records each, `ends` tells where those
# of each end, counted from the first.
cdef struct Piece:
    int kind
    size_t stride
    Frame frame
    const Node* nodes
    const unsigned char* records
    const uint32_t* ends    # NULL where each object has one record
    uint32_t begin          # where the first begins, by that count
    uint64_t first          # the id of the first object

# A ray on its way down: its line, as nodes see it, and the nearest hit so far.
cdef struct Search:
    Line line
    Shear seen
    Slope slope
    NodeSpan spans
    double t
    uint64_t id
    float reach     # t, rounded up
    uint8_t kind    # of the ray: any hit ends a shadow ray
    uint32_t mark   # which ray, for crossings
    void* order     # a GivenOrder
    void* crossings     # a CrossingBuffer where all hits are wanted, or NULL
    int64_t node_tests
    int64_t object_tests


cdef inline void set_reach(Search* s, double t) noexcept nogil:
    """Have the search end at t."""
    s.t = t
    s.reach = above(t)


cdef inline void aim(Search* s, const Line* l, double grow) noexcept nogil:
    """Set up a search along a line."""
    s.line = l[0]
    s.slope = slope_of(l, grow)
    s.seen = shear_along(l)


cdef inline int meet_object(const Piece* p, uint32_t i, Search* s) except -1 nogil:
    """Test one object, and keep its hit if it is nearer, or all of its hits."""
    cdef Shape shape
    cdef BoxHit m
    cdef Box box
    cdef uint32_t begin = i, n = 0
    if p.ends != NULL:
        begin = (p.ends[i - 1] if i > 0 else p.begin) - p.begin
        n = p.ends[i] - p.begin - begin
    s.object_tests += 1
    if shape_missed(p.kind, p.records + begin * p.stride, &p.frame, &s.line, &s.seen):
        return 0
    if not shape_load(p.kind, p.records + begin * p.stride, n, &p.frame, &shape):
        return 0
    shape_bounds(&shape, &box)
    if not box_span(&box, s.slope.grow, &s.line, &m.span) or m.span.near > s.t:
        return 0
    m.line = s.line
    if s.crossings != NULL:
        m.mark = s.mark
        return cross(<CrossingBuffer>s.crossings, &shape, &m, s.t, p.first + i)
    shape_meet(&shape, &m, 1)
    if 0.0 <= m.t <= s.t and (
        m.t < s.t or s.id == NO_HIT or comes_first(<GivenOrder>s.order, p.first + i, s.id)
    ):
        s.id = p.first + i
        set_reach(s, -1.0 if s.kind == SHADOW else m.t)
    return 0


cdef inline int meet_leaves(const Piece* p, const Node* node, unsigned int met,
                            Search* s) except -1 nogil:
    """Test the objects of those leaves of a node that the ray meets."""
    cdef uint32_t first = node.first
    cdef uint32_t i
    cdef int c
    for c in range(WIDE):
        if node.count[c] != INNER and node.count[c]:
            if met >> c & 1:
                for i in range(first, first + node.count[c]):
                    meet_object(p, i, s)
            first += node.count[c]
    return 0


cdef inline int walk_treelet(const Piece* p, Search* s) except -1 nogil:
    """Test a ray against the objects of a treelet."""
    cdef uint32_t waiting[WAITING]
    cdef float entry[WAITING]
    cdef float near[8]
    cdef const Node* node = p.nodes
    cdef unsigned int met
    cdef int n = 0
    while True:
        s.node_tests += 1
        met = s.spans(node, &s.slope, s.reach, near)
        if met & ~<unsigned int>node.inner:
            meet_leaves(p, node, met, s)  # first, for what they hit may spare nodes
        n = keep_inner(node, met, near, s.reach, waiting, entry, n)
        while n > 0 and entry[n - 1] > s.reach:
            n -= 1
        if n == 0:
            return 0
        n -= 1
        node = p.nodes + waiting[n]


cdef inline int keep_inner(const Node* node, unsigned int met, const float* near, float reach,
                           uint32_t* waiting, float* entry, int n) noexcept nogil:
    """Add the children that are nodes to those that wait, of which there are n, the farthest at the
    bottom of those added; return how many wait then."""
    cdef int k, base = n, c
    cdef float t
    met &= node.inner
    while met:
        c = lowest_bit(met)
        met &= met - 1
        t = near[c]
        if t > reach:
            continue
        k = n
        while k > base and entry[k - 1] < t:
            entry[k], waiting[k] = entry[k - 1], waiting[k - 1]
            k -= 1
        entry[k] = t
        waiting[k] = node.child + <uint32_t>ones(node.inner & ((1 << c) - 1))
        n += 1
    return n
