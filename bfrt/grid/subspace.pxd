"""A part of the grid that is preprocessed by itself (the paper's section 3.2)."""

from libc.stdint cimport int64_t

from bfrt.geometry.box cimport Box, box_empty
from bfrt.grid.planes cimport Planes, Range, roughly


cdef class Subspace:
    cdef Range range        # its voxels, inclusive, an axis
    cdef int axis           # across its layers
    cdef int64_t stride[3]  # of a voxel in its own marks, an axis


cdef inline bint box_near(const Box* b, const Planes* g, Subspace s) noexcept nogil:
    """Tell whether a box may have a voxel in the subspace: with slack, so that none is missed."""
    cdef int k = s.axis
    return (
        not box_empty(b)
        and roughly(g, k, b.lo[k], -g.slack[k]) <= s.range.hi[k]
        and roughly(g, k, b.hi[k], g.slack[k]) >= s.range.lo[k]
    )
