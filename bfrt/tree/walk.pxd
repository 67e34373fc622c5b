"""Walks of one ray down a treelet: nodes by entry, exact tests at the leaves.

The order is that of entry, nearest first, so that hits soon end the walk; it changes no answer.
"""

from libc.stdint cimport int64_t, uint8_t, uint32_t, uint64_t

from bfrt.bits cimport lowest_bit, ones_of_eight
from bfrt.geometry.box cimport Box, box_span
from bfrt.geometry.coordinates cimport Frame
from bfrt.geometry.four cimport FourRay, FourTest, four_ray
from bfrt.geometry.outline cimport Shear, shear_along
from bfrt.geometry.polygon cimport Polygon, polygon_load
from bfrt.geometry.shape cimport (
    BoxHit, Shape, shape_bounds, shape_load, shape_meet, shape_missed,
)
from bfrt.geometry.vector cimport Line
from bfrt.phases.crossings cimport CrossingBuffer, cross
from bfrt.phases.pending cimport prefetch
from bfrt.records cimport NO_HIT, SHADOW
from bfrt.scan.given_order cimport GivenOrder, comes_first
from bfrt.tree.sight cimport (
    Heading, Sight, Spans, heading_of, prefetch_node, sight_of, sight_reach,
)
from bfrt.tree.sketch cimport Begins
from bfrt.treelets.node cimport Node, leaf_counts, objects_before

cdef enum:
    # Nodes of a walk that wait at the most: seven a level, of the 32 levels that the build splits
    # by its heuristic and of 32 that halve what is below (build.pyx), and the last node's eight.
    WAITING = 7 * (32 + 32) + 8

# A treelet's nodes and records. Of objects that have several records each, `ends` tells where those
# of each end, counted from the first.
cdef struct Piece:
    int kind
    size_t stride
    Frame frame
    FourTest four
    const Box* box
    const Node* nodes
    const Begins* begins    # where the leaves of these begin, or NULL where the nodes tell
    const unsigned char* records
    const Box* boxes        # of the objects, NULL where each has one record, of which it is made
    const uint32_t* ends    # NULL where each object has one record
    uint32_t begin          # where the first of those that are there begins, by that count
    uint32_t skipped        # how many before that are not there
    uint64_t first          # the id of the first object
    uint32_t objects

# A ray on its way down: its line, and the nearest hit so far.
cdef struct Search:
    Line line
    Shear seen
    FourRay four
    Heading heading
    Spans spans
    double t
    uint64_t id
    uint8_t kind    # of the ray: any hit ends a shadow ray
    uint32_t mark   # which ray, for crossings
    Polygon polygon     # the one that was met last: to load it takes long, and rays come together
    uint64_t polygon_id
    void* order     # a GivenOrder
    void* crossings     # a CrossingBuffer where all hits are wanted, or NULL
    int64_t node_tests
    int64_t object_tests

# Nodes that wait for a ray, in a frame of theirs, the nearest on top.
cdef struct Waits:
    float entry
    uint32_t what

cdef struct Waiting:
    int n
    Waits at[WAITING]


cdef inline void wait_among(Waiting* w, int base, float entry, uint32_t what) noexcept nogil:
    """Add what waits, in its place among those added since there were `base`."""
    cdef int k = w.n
    while k > base and w.at[k - 1].entry < entry:
        w.at[k] = w.at[k - 1]
        k -= 1
    w.at[k].entry, w.at[k].what = entry, what
    w.n += 1


cdef inline bint next_waiting(Waiting* w, float reach, uint32_t* what) noexcept nogil:
    """Take the nearest that waits; false if none is within reach."""
    while w.n > 0:
        w.n -= 1
        if w.at[w.n].entry <= reach:
            what[0] = w.at[w.n].what
            return True
    return False


cdef inline void aim(Search* s, const Line* l, double grow) noexcept nogil:
    """Set up a search along a line, among boxes that are grown by d (exactness rule 1)."""
    s.line = l[0]
    s.heading = heading_of(l, grow)
    s.seen = shear_along(l)
    s.four = four_ray(l, &s.seen)


cdef inline bint enters(const Box* box, const Search* s, BoxHit* m) noexcept nogil:
    """Tell whether a ray is in an object's box before its hit so far."""
    return box_span(box, s.heading.grow, &s.line, &m.span) and m.span.near <= s.t


cdef inline bint load_polygon(const Piece* p, uint32_t i, Search* s, Shape* shape,
                              BoxHit* m) noexcept nogil:
    """Load an object of several records, if the ray may meet it."""
    cdef uint32_t begin = (p.ends[i - 1] if i > p.skipped else p.begin) - p.begin
    cdef uint32_t n = p.ends[i] - p.begin - begin
    cdef const unsigned char* record = p.records + begin * p.stride
    if not enters(&p.boxes[i], s, m) or shape_missed(
        p.kind, record, n, &p.frame, &s.line, &s.seen
    ):
        return False
    if s.polygon_id != p.first + i or s.polygon.count != n:  # of a file that others change
        s.polygon_id = NO_HIT
        if not polygon_load(record, n, &p.frame, &s.polygon):
            return False
        s.polygon_id = p.first + i
    s.polygon.vertices = record
    shape.kind, shape.of.polygon = p.kind, s.polygon
    return True


cdef inline bint load_shape(const Piece* p, uint32_t i, Search* s, Shape* shape,
                            BoxHit* m) noexcept nogil:
    """Load an object, if the ray enters its box before its hit so far."""
    cdef Box box
    if p.ends != NULL:
        return load_polygon(p, i, s, shape, m)
    if not shape_load(p.kind, p.records + i * p.stride, 1, &p.frame, shape):
        return False
    shape_bounds(shape, &box)
    return enters(&box, s, m)


cdef inline int meet_object(const Piece* p, uint32_t i, Search* s) except -1 nogil:
    """Test one object, and keep its hit if it is nearer, or all of its hits."""
    cdef Shape shape
    cdef BoxHit m
    if not load_shape(p, i, s, &shape, &m):
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
        s.t = -1.0 if s.kind == SHADOW else m.t
    return 0


cdef inline int meet_leaf(const Piece* p, uint32_t first, uint32_t end, Search* s) except -1 nogil:
    """Test the objects of a leaf: those that are not missed at the first look."""
    cdef uint32_t i = first, n
    cdef unsigned int maybe
    s.object_tests += end - first
    while i < end:
        n = min(end - i, <uint32_t>4)
        if p.four != NULL:
            maybe = p.four(p.records + i * p.stride, p.stride, <int>n, &s.four)
            while maybe:
                meet_object(p, i + <uint32_t>lowest_bit(maybe), s)
                maybe &= maybe - 1
        else:
            for i in range(i, i + n):
                if p.ends != NULL or not shape_missed(
                    p.kind, p.records + i * p.stride, 1, &p.frame, &s.line, &s.seen
                ):
                    meet_object(p, i, s)
            i += 1 - n
        i += n
    return 0


# Objects of a treelet, from its first on.
cdef struct Range:
    uint32_t begin
    uint32_t end


cdef inline Range take_leaf(const Piece* p, uint32_t of, unsigned int* met) noexcept nogil:
    """Take the first of a node's leaves that are met: return its objects."""
    cdef const Node* node = p.nodes + of
    cdef int c = lowest_bit(met[0])
    cdef Range leaf
    met[0] &= met[0] - 1
    if p.begins == NULL:
        leaf.begin = node.first + (objects_before(leaf_counts(node)) >> 8 * c & 0xFF)
    else:
        leaf.begin = p.begins[of].of[c]
    leaf.end = leaf.begin + node.count[c]
    return leaf


cdef inline int meet_leaves(const Piece* p, uint32_t of, unsigned int met,
                            Search* s) except -1 nogil:
    """Test the objects of those children that are leaves and that the ray meets."""
    cdef Range leaf
    while met:
        leaf = take_leaf(p, of, &met)
        meet_leaf(p, leaf.begin, leaf.end, s)
    return 0


cdef inline void prefetch_leaves(const Piece* p, uint32_t of, unsigned int met) noexcept nogil:
    """Have the records of leaves come from memory."""
    cdef const unsigned char* r
    cdef const unsigned char* end
    cdef Range leaf
    if p.ends != NULL:
        return
    while met:
        leaf = take_leaf(p, of, &met)
        r = p.records + leaf.begin * p.stride
        end = p.records + leaf.end * p.stride
        while r < end:
            prefetch(r)
            r += 64
        prefetch(end - 1)


cdef inline void wait_inner(const Node* nodes, uint32_t of, unsigned int met, const float* near,
                            Waiting* w) noexcept nogil:
    """Add the children of a node that are nodes to those that wait, the farthest first."""
    cdef const Node* node = nodes + of
    cdef uint32_t child
    cdef int base = w.n, c
    met &= node.inner
    while met:
        c = lowest_bit(met)
        met &= met - 1
        child = node.child + <uint32_t>ones_of_eight(node.inner & ((1 << c) - 1))
        prefetch_node(nodes + child)
        wait_among(w, base, near[c], child)


cdef inline int walk_treelet(const Piece* p, Search* s) except -1 nogil:
    """Test a ray against the objects of a treelet."""
    cdef Sight sight = sight_of(&s.heading, p.box)
    cdef float reach = sight_reach(&sight, s.t)
    cdef float near[8]
    cdef Waiting w
    cdef double t = s.t
    cdef uint32_t what = 0
    cdef unsigned int met, leaves
    w.n = 0
    while True:
        s.node_tests += 1
        met = s.spans(p.nodes + what, &sight, reach, near)
        leaves = met & ~<unsigned int>p.nodes[what].inner
        if leaves:
            meet_leaves(p, what, leaves, s)  # first, for what they hit may spare nodes
            if s.t != t:
                t = s.t
                reach = sight_reach(&sight, t)
        wait_inner(p.nodes, what, met, near, &w)
        if not next_waiting(&w, reach, &what):
            return 0


cdef inline void widen(Range* wide, uint32_t begin, uint32_t end) noexcept nogil:
    """Have a range hold another one too."""
    if wide.end == 0:
        wide.begin, wide.end = begin, end
    else:
        wide.begin, wide.end = min(wide.begin, begin), max(wide.end, end)


cdef inline void widen_by_leaves(Range* wide, const Piece* p, uint32_t of,
                                 unsigned int met) noexcept nogil:
    """Have a range hold the objects of leaves that are met."""
    cdef Range leaf
    while met:
        leaf = take_leaf(p, of, &met)
        widen(wide, leaf.begin, leaf.end)


cdef inline void look_for_leaves(const Piece* p, Search* s, Range* wide) noexcept nogil:
    """Have a range hold all objects that `walk_treelet` can come to, by a treelet's nodes alone."""
    cdef Sight sight = sight_of(&s.heading, p.box)
    cdef float reach = sight_reach(&sight, s.t)
    cdef float near[8]
    cdef Waiting w
    cdef uint32_t what = 0
    cdef unsigned int met
    w.n = 0
    while True:
        s.node_tests += 1
        met = s.spans(p.nodes + what, &sight, reach, near)
        widen_by_leaves(wide, p, what, met & ~<unsigned int>p.nodes[what].inner)
        wait_inner(p.nodes, what, met, near, &w)
        if not next_waiting(&w, reach, &what):
            return
