"""Sketches of treelets that stream: upper nodes, which stay in memory and stand for all of them.

A sketch has the nodes of a treelet that most objects are below. What is below any other node is one
leaf of it, whose objects lie together, for a treelet's objects are depth first: rays that are few
are tested against these, and the treelet's own nodes, a fifth of its bytes, are not read again.
"""

from libc.stdint cimport int64_t, uint8_t, uint16_t, uint32_t

from bfrt.records cimport NODE_BYTES
from bfrt.treelets.node cimport INNER, WIDE, Node, leaf_objects

cdef enum:
    FEWEST_DRAWN = 4    # nodes of a sketch: fewer leave too many objects below each child
    MOST_DRAWN = 9      # the root and all of its children
    MOST_NODES = 1024   # of a treelet that is drawn, as its objects
    MOST_BELOW = 127    # objects of a leaf, by the bits of a count that `leaf_counts` has for them

# A node of a sketch, and where the objects of its leaves begin, from the treelet's first on.
cdef struct Begins:
    uint16_t of[8]

cdef enum:
    DRAWN_BYTES = NODE_BYTES + 8 * 2    # of a node of a sketch, and its begins

# What is below each node of a treelet, while it is drawn.
cdef struct Below:
    uint16_t size[MOST_NODES]
    uint8_t drawn[MOST_NODES]


cdef inline bint measure(const Node* nodes, uint32_t n, Below* below) noexcept nogil:
    """Count the objects below each node; false if they do not lie together."""
    cdef const Node* node
    cdef uint32_t child, at
    cdef int64_t k
    cdef int c
    for k in range(<int64_t>n - 1, -1, -1):
        node = nodes + k
        child, at = node.child, node.first + leaf_objects(node)
        for c in range(WIDE):
            if node.count[c] == INNER:
                if nodes[child].first != at:
                    return False
                at += below.size[child]
                child += 1
        below.size[k] = <uint16_t>(at - node.first)
        below.drawn[k] = False
    return True


cdef inline void choose(const Node* nodes, int most, Below* below) noexcept nogil:
    """Choose the nodes that are drawn: the root, and then the largest child of those, each time."""
    cdef uint32_t drawn[MOST_DRAWN]
    cdef uint32_t child, largest
    cdef int n = 1, k, c
    drawn[0], below.drawn[0] = 0, True
    while n < most:
        largest = 0
        for k in range(n):
            child = nodes[drawn[k]].child
            for c in range(WIDE):
                if nodes[drawn[k]].count[c] == INNER:
                    if not below.drawn[child] and (
                        largest == 0 or below.size[child] > below.size[largest]
                    ):
                        largest = child
                    child += 1
        if largest == 0:
            return
        drawn[n], below.drawn[largest] = largest, True
        n += 1


cdef inline bint draw_node(const Node* nodes, uint32_t of, const Below* below, uint32_t* next,
                           Node* drawn, Begins* begins) noexcept nogil:
    """Draw a node, whose children that are drawn follow from `next`; false if too many objects are
    below another one.
    """
    cdef const Node* node = nodes + of
    cdef uint32_t child = node.child, first = node.first
    cdef int c
    drawn[0] = node[0]
    drawn.child, drawn.inner = next[0], 0
    for c in range(WIDE):
        begins.of[c] = <uint16_t>first
        if node.count[c] != INNER:
            first += node.count[c]
            continue
        if below.drawn[child]:
            drawn.inner |= <uint8_t>(1 << c)
            next[0] += 1
        elif below.size[child] > MOST_BELOW:
            return False
        else:
            drawn.count[c] = <uint8_t>below.size[child]
            begins.of[c] = <uint16_t>nodes[child].first
        child += 1
    return True


cdef inline bint draw(const Node* nodes, uint32_t n, uint32_t objects, int most, Node* drawn,
                      Begins* begins) noexcept nogil:
    """Draw a treelet of n nodes with `most` nodes, FEWEST_DRAWN to MOST_DRAWN; false if it has too
    many objects, or they do not lie together.
    """
    cdef Below below
    cdef uint32_t k, next = 1
    cdef int at = 0
    if n > MOST_NODES or objects > 0xFFFF or not measure(nodes, n, &below):
        return False
    choose(nodes, most, &below)
    for k in range(n):
        if below.drawn[k]:
            if not draw_node(nodes, k, &below, &next, drawn + at, begins + at):
                return False
            at += 1
    return True
