"""What nodes and walks of the tree say, one call at a time.

Tests ask it, and brute force too.
"""

from libc.stdint cimport int64_t, uint8_t, uint16_t, uint32_t

import numpy as np

from bfrt.geometry.box cimport Box, Span, box_add, box_clear, box_span
from bfrt.geometry.vector cimport Line, line, vec
from bfrt.tree.sight cimport Heading, Sight, heading_of, sight_of, sight_reach, spans_of
from bfrt.tree.sketch cimport MOST_DRAWN, Begins, draw
from bfrt.tree.top cimport MOST_CANDIDATES, Entry, Look, Top, next_treelets
from bfrt.treelets.node cimport WIDE, Node, node_boxes, quantum_of


cdef Line ray_of(origin, direction):
    return line(vec(origin[0], origin[1], origin[2]), vec(direction[0], direction[1], direction[2]))


def node_of(const float[:, ::1] boxes):
    """Return the node, 80 bytes, of one to eight leaves of one object each, (n, 6) float32."""
    cdef uint8_t[::1] memory = np.zeros(sizeof(Node), np.uint8)
    cdef Node* node = <Node*>&memory[0]
    cdef int i
    node_boxes(node, <const Box*>&boxes[0, 0], <int>boxes.shape[0])
    for i in range(boxes.shape[0]):
        node.count[i] = 1
    return np.asarray(memory)


def node_sides(const uint8_t[::1] memory):
    """Return the boxes of a node's eight children, (8, 6) float64, as they are decoded."""
    cdef const Node* node = <const Node*>&memory[0]
    cdef double[:, ::1] sides = np.empty((8, 6))
    cdef int i, k
    for i in range(WIDE):
        for k in range(3):
            sides[i, k] = node.low[k] + node.lo[k][i] * quantum_of(node.exponent[k])
            sides[i, 3 + k] = node.low[k] + node.hi[k][i] * quantum_of(node.exponent[k])
    return np.asarray(sides)


def node_met(const uint8_t[::1] memory, const float[::1] around, ray, double grow, double reach,
             bint plain):
    """Return which children a ray, (origin, direction), enters by `reach`, as bits, and when at the
    latest, (8,); the node is of a treelet with this box around it, (6,)."""
    cdef const Box* box = <const Box*>&around[0]
    cdef Line l = ray_of(ray[0], ray[1])
    cdef Heading heading = heading_of(&l, grow)
    cdef Sight sight = sight_of(&heading, box)
    cdef float near[8]
    cdef unsigned int met = spans_of(plain)(
        <const Node*>&memory[0], &sight, sight_reach(&sight, reach), near
    )
    return met, sight.start + np.asarray(<float[:8]>near).astype(float) / sight.unit


def box_met(const float[::1] box, origin, direction, double grow):
    """Return the span in which a ray is inside a box grown by `grow`, or None."""
    cdef Line l = ray_of(origin, direction)
    cdef Span span
    if not box_span(<const Box*>&box[0], grow, &l, &span):
        return None
    return span.near, span.far


def drawn(const uint8_t[::1] nodes, uint32_t objects, int most):
    """Return the sketch of a treelet, of `most` nodes at the most: these, as bytes, (most, 80), and
    where the leaves of each begin, (most, 8); None if it cannot be drawn.
    """
    cdef uint8_t[:, ::1] memory = np.zeros((MOST_DRAWN, sizeof(Node)), np.uint8)
    cdef uint16_t[:, ::1] begins = np.zeros((MOST_DRAWN, 8), np.uint16)
    if not draw(
        <const Node*>&nodes[0], <uint32_t>(nodes.shape[0] // sizeof(Node)), objects, most,
        <Node*>&memory[0, 0], <Begins*>&begins[0, 0],
    ):
        return None
    return np.asarray(memory)[:most], np.asarray(begins)[:most]


cdef class TopTree:
    """Finds the treelets that rays enter, by a tree above them.

    Parameters
    ----------
    nodes, leaves : (nodes,) records.NODE, as bytes, and (treelets,) uint32
        As `TreeletBuilder` makes them, of leaves of one.
    boxes : (treelets, 6) float32
    plain : bool
        Whether boxes are tested without wide vectors.
    padding : float
        By which boxes are grown.
    """

    cdef const uint8_t[::1] nodes
    cdef const uint32_t[::1] leaves
    cdef const float[:, ::1] boxes
    cdef Top top

    def __cinit__(self, const uint8_t[::1] nodes, const uint32_t[::1] leaves,
                  const float[:, ::1] boxes, bint plain, double padding=0.0):
        cdef int64_t i
        self.nodes, self.leaves, self.boxes = nodes, leaves, boxes
        self.top.nodes, self.top.leaves = <const Node*>&nodes[0], &leaves[0]
        self.top.boxes, self.top.stride = <const unsigned char*>&boxes[0, 0], sizeof(Box)
        self.top.count, self.top.padding = boxes.shape[0], padding
        self.top.spans = spans_of(plain)
        box_clear(&self.top.around)
        for i in range(boxes.shape[0]):
            box_add(&self.top.around, <const Box*>&boxes[i, 0])

    def next(self, ray, first, double reach, int most):
        """Return the next treelets that a ray, (origin, direction), enters, from (t, treelet)
        `first` on: [(t, treelet), ...]."""
        cdef Line l = ray_of(ray[0], ray[1])
        cdef Entry found[MOST_CANDIDATES]
        cdef Look look
        cdef int i, n
        look.first.t, look.first.treelet = first
        look.reach, look.most, look.node_tests = reach, most, 0
        n = next_treelets(&self.top, &l, &look, found)
        return [(found[i].t, found[i].treelet) for i in range(n)]
