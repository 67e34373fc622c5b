"""A part of the grid that is preprocessed by itself (the paper's section 3.2, figure 3)."""

cimport cython

from bfrt.geometry.lattice cimport Lattice


@cython.final
cdef class Subspace:
    """A box of voxels.

    Parameters
    ----------
    lattice : Lattice
        The grid.
    begin, end : tuple of 3 int
        The first voxel and the one beyond the last, in (layers, rows, row).
    """

    def __cinit__(self, Lattice lattice, begin, end):
        cdef int64_t stride = 1
        cdef int j, k
        for j in range(3):
            k = lattice.grid.order[j]
            self.range.lo[k] = begin[2 - j]
            self.range.hi[k] = end[2 - j] - 1
            self.stride[k] = stride
            stride *= end[2 - j] - begin[2 - j]
