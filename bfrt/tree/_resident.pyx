"""A prototype: a whole stream in memory."""

cimport cython
from libc.stdint cimport int64_t, uint8_t, uint32_t, uint64_t
from libc.math cimport INFINITY

import numpy as np
from bfrt.geometry.coordinates cimport Frame
from bfrt.geometry.vector cimport Line, Vec, line, vec
from bfrt.geometry.box cimport above
from bfrt.tree.node cimport Node, node_spanner, slope_of
from bfrt.tree.walk cimport Piece, Search, walk_treelet

def trace(const uint8_t[::1] nodes, const uint8_t[::1] records, int kind, size_t stride, double grow,
          const double[:, ::1] origins, const double[:, ::1] directions, double[::1] t,
          uint64_t[::1] places):
    cdef Piece p
    cdef Search s
    cdef int64_t i
    cdef uint64_t a = 0, b = 0
    p.kind, p.stride = kind, stride
    p.records = &records[0]
    p.nodes = <const Node*>&nodes[0]
    p.frame.wide = False
    s.spans = node_spanner(False)
    s.node_tests = s.object_tests = 0
    with nogil:
        for i in range(origins.shape[0]):
            s.line = line(vec(origins[i, 0], origins[i, 1], origins[i, 2]), vec(directions[i, 0], directions[i, 1], directions[i, 2]))
            s.slope = slope_of(&s.line, grow)
            s.t = INFINITY
            s.reach = INFINITY
            s.place = <uint64_t>-1
            walk_treelet(&p, 0, &s)
            t[i], places[i] = s.t, s.place
    return s.node_tests, s.object_tests
