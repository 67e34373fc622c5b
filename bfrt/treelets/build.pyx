"""The build of treelets: a window of boxes becomes treelets, each with its tree.

::

    boxes ─► references ─► split to TREELET_OBJECTS or fewer ─► a treelet each
                                                                   │ split to leaves
                                                        nodes, breadth first; objects, depth first
"""

cimport cython
from cpython.mem cimport PyMem_RawFree, PyMem_RawMalloc
from libc.stdint cimport int64_t, uint8_t, uint32_t, uint64_t

import numpy as np

from bfrt.geometry.box cimport Box, box_empty
from bfrt.records cimport Treelet
from bfrt.treelets.node cimport INNER, LARGEST_LEAF, WIDE, Node, leaf_objects, node_boxes
from bfrt.treelets.split cimport (
    RangeBox, Reference, half_surface, range_bounds, range_box, refer, referred, split_range,
)

from bfrt.records import NODE, TREELET

#: Objects of a treelet, and of a leaf, at the most.
TREELET_OBJECTS = 1024
LEAF_OBJECTS = 4

cdef enum:
    DEEPEST = 32        # levels by the heuristic; what is below is halved
    STACK = 64 + 8      # ranges that wait at the most: a level each, and 2^32 objects take 32 more

cdef struct Range:
    int64_t first
    int64_t end
    int depth
    int64_t place       # where its objects come to in the order
    RangeBox around


@cython.final
cdef class TreeletBuilder:
    """Builds the treelets of windows, one after another.

    Parameters
    ----------
    most, leaf : int
        Objects of a treelet, and of a leaf, at the most; up to 31 in a leaf.
    """

    cdef object node_records, treelet_records, order_records
    cdef Node* node
    cdef Treelet* treelet
    cdef uint32_t* placed
    cdef Reference* refs
    cdef Range* ranges      # those that wait to become treelets, then a treelet's that become nodes
    cdef int64_t node_count, treelet_count, place
    cdef int64_t most, leaf, capacity

    def __cinit__(self, int64_t most=TREELET_OBJECTS, int64_t leaf=LEAF_OBJECTS):
        self.most, self.leaf, self.capacity = max(most, leaf), min(leaf, LARGEST_LEAF), -1
        # Aligned to 16 bytes, as memory that is asked for is, and vectors of four have to be.
        self.ranges = <Range*>PyMem_RawMalloc((self.most + STACK) * sizeof(Range))
        if self.ranges == NULL:
            raise MemoryError("the ranges of a treelet")

    def __dealloc__(self):
        PyMem_RawFree(self.ranges)
        PyMem_RawFree(self.refs)

    cdef int make_room(self, int64_t n) except -1:
        """Take memory for n objects; every node has an object of its own, or two nodes."""
        cdef uint8_t[::1] nodes, treelets
        cdef uint32_t[::1] order
        if n <= self.capacity:
            return 0
        self.node_records = np.empty(n + 1, NODE)
        self.treelet_records = np.empty(n + 1, TREELET)
        self.order_records = np.empty(n + 1, np.uint32)
        nodes, treelets = self.node_records.view(np.uint8), self.treelet_records.view(np.uint8)
        order = self.order_records
        self.node, self.treelet = <Node*>&nodes[0], <Treelet*>&treelets[0]
        self.placed = &order[0]
        PyMem_RawFree(self.refs)
        self.refs = <Reference*>PyMem_RawMalloc((n + 1) * sizeof(Reference))
        if self.refs == NULL:
            self.capacity = -1
            raise MemoryError(f"the boxes of {n} objects")
        self.capacity = n
        return 0

    def build(self, const float[:, :] boxes):
        """Build the treelets of a window.

        Parameters
        ----------
        boxes : (n, 6) float32
            The six of each are side by side. Empty ones are in no treelet: they come last.

        Returns
        -------
        nodes : (nodes,) records.NODE
        treelets : (treelets,) records.TREELET
            None where all boxes are empty.
        order : (n,) uint32
            The window's objects, in the order of the treelets. All three are memory that the next
            build changes.
        """
        cdef int64_t i, n = 0, count = boxes.shape[0]
        self.make_room(count)
        self.node_count = self.treelet_count = self.place = 0
        with nogil:
            for i in range(count):
                if not box_empty(<const Box*>&boxes[i, 0]):
                    refer(&self.refs[n], &boxes[i, 0], &boxes[i, 3], <uint32_t>i)
                    n += 1
            if n:
                self.part(n)
            for i in range(count):
                if box_empty(<const Box*>&boxes[i, 0]):
                    self.placed[self.place] = <uint32_t>i
                    self.place += 1
        return (
            self.node_records[: self.node_count],
            self.treelet_records[: self.treelet_count],
            self.order_records[:count],
        )

    cdef void part(self, int64_t n) noexcept nogil:
        """Part a window of n references into treelets."""
        cdef Range* stack = self.ranges
        cdef Range whole
        cdef Range* below
        cdef int64_t depth = 1, middle
        stack[0].first, stack[0].end, stack[0].depth = 0, n, 0
        range_bounds(self.refs, n, &stack[0].around)
        while depth:
            depth -= 1
            whole = stack[depth]
            if whole.end - whole.first <= self.most:
                self.treelet_of(&whole)
                continue
            below = &stack[depth]
            middle = whole.first + split_range(
                self.refs + whole.first, whole.end - whole.first, whole.depth >= DEEPEST,
                &below[1].around, &below[0].around,
            )
            below[1].first, below[1].end = whole.first, middle
            below[0].first, below[0].end = middle, whole.end
            below[0].depth = below[1].depth = whole.depth + 1
            depth += 2

    cdef void treelet_of(self, const Range* whole) noexcept nogil:
        """Build one treelet: its nodes, breadth first, and its objects, depth first."""
        cdef Treelet* t = &self.treelet[self.treelet_count]
        cdef Node* nodes = self.node + self.node_count
        cdef Range* queue = self.ranges + STACK
        cdef int64_t k = 0, count = 1
        (<Box*>t)[0] = range_box(&whole.around)
        t.first, t.node = <uint64_t>self.place, <uint64_t>self.node_count
        queue[0] = whole[0]
        queue[0].depth = 0
        while k < count:
            count += self.expand(&queue[k], nodes + k, <uint32_t>count, &queue[count])
            k += 1
        self.place_objects(nodes, queue, count)
        t.count = <uint32_t>(whole.end - whole.first)
        self.place += t.count
        t.nodes = <uint32_t>count
        self.node_count += count
        self.treelet_count += 1

    cdef void place_objects(self, Node* nodes, Range* ranges, int64_t n) noexcept nogil:
        """Bring the objects of n nodes, of these ranges, to their places: those of a node's leaves
        first, then those below each child, so that whatever is below a node lies together.
        """
        cdef Node* node
        cdef int64_t k, i, place, below, taken
        cdef uint32_t child
        cdef int c
        ranges[0].place = self.place
        for k in range(n):
            node, place, child = nodes + k, ranges[k].place, nodes[k].child
            node.first = <uint32_t>(place - self.place)
            below = place + leaf_objects(node)
            taken = ranges[k].first
            for c in range(WIDE):
                if node.count[c] == INNER:
                    ranges[child].place = below
                    below += ranges[child].end - ranges[child].first
                    taken = ranges[child].end
                    child += 1
                    continue
                for i in range(taken, taken + node.count[c]):
                    self.placed[place] = referred(&self.refs[i])
                    place += 1
                taken += node.count[c]

    cdef int expand(self, const Range* whole, Node* node, uint32_t child,
                    Range* queue) noexcept nogil:
        """Make a node; queue the children that are nodes, and return how many."""
        cdef Range part[8]
        cdef Box boxes[8]
        cdef Range right
        cdef float area, largest
        cdef int i, n = 1, widest, inner = 0
        cdef int64_t middle
        part[0] = whole[0]
        while n < WIDE:
            widest, largest = -1, -1.0
            for i in range(n):
                area = half_surface(&part[i].around)
                if part[i].end - part[i].first > self.leaf and area > largest:
                    widest, largest = i, area
            if widest < 0:
                break
            middle = part[widest].first + split_range(
                self.refs + part[widest].first, part[widest].end - part[widest].first,
                whole.depth >= DEEPEST, &part[widest].around, &right.around,
            )
            right.first, right.end = middle, part[widest].end
            part[widest].end = middle
            for i in range(n, widest + 1, -1):
                part[i] = part[i - 1]
            part[widest + 1] = right
            n += 1
        node.child, node.inner = child, 0
        for i in range(WIDE):
            node.count[i] = 0
        for i in range(n):
            boxes[i] = range_box(&part[i].around)
            if part[i].end - part[i].first > self.leaf:
                node.count[i] = INNER
                node.inner |= <uint8_t>(1 << i)
                queue[inner] = part[i]
                queue[inner].depth = whole.depth + 1
                inner += 1
                continue
            node.count[i] = <uint8_t>(part[i].end - part[i].first)
        node_boxes(node, boxes, n)
        return inner
