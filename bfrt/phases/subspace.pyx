"""A part of the grid that is preprocessed by itself (the paper's section 3.2)."""

cimport cython

from bfrt.geometry.lattice cimport Lattice


@cython.final
cdef class Subspace:
    """Some layers of voxels.

    Parameters
    ----------
    lattice : Lattice
        The grid.
    first, end : int
        The first layer and the one beyond the last.
    """

    def __cinit__(self, Lattice lattice, int first, int end):
        cdef int64_t stride = 1
        cdef int j, k
        for j in range(3):
            k = lattice.grid.order[j]
            self.range.lo[k] = 0
            self.range.hi[k] = lattice.grid.n[k] - 1
            self.stride[k] = stride
            stride *= lattice.grid.n[k]
        self.axis = lattice.grid.order[2]
        self.range.lo[self.axis] = first
        self.range.hi[self.axis] = end - 1
