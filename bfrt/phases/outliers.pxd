"""The few objects outside the grid, in memory."""

from libc.stdint cimport int64_t, uint64_t

from bfrt.geometry.box cimport Box, Span, box_span
from bfrt.geometry.shape cimport BoxHit, Shape, shape_meet
from bfrt.geometry.vector cimport Line
from bfrt.phases.nearest cimport nearer
from bfrt.records cimport Ray
from bfrt.scan.given_order cimport GivenOrder

cdef struct Outlier:
    Shape shape
    Box box
    uint64_t id


cdef class Outliers:
    cdef Outlier* outliers
    cdef readonly int count
    cdef list records  # what the shapes point into
    cdef GivenOrder order


cdef inline void meet_outliers(Outliers self, Ray* ray, const Line* line, double padding,
                               int64_t* box_tests, int64_t* object_tests) noexcept nogil:
    """Test a ray against each of them."""
    cdef BoxHit m
    cdef int i
    m.line = line[0]
    for i in range(self.count):
        box_tests[0] += 1
        if not box_span(&self.outliers[i].box, padding, line, &m.span) or m.span.near > ray.t:
            continue
        object_tests[0] += 1
        shape_meet(&self.outliers[i].shape, &m, 1)
        if m.t >= 0.0:
            nearer(ray, m.t, self.outliers[i].id, self.order)
