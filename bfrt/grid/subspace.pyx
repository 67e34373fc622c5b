"""A part of the grid that is preprocessed by itself (the paper's section 3.2)."""

cimport cython

from bfrt.grid.grid cimport Grid


@cython.final
cdef class Subspace:
    """Describes some layers of voxels of a grid.

    Parameters
    ----------
    grid : Grid
        The grid.
    first, end : int
        The first layer and the one beyond the last.
    """

    def __cinit__(self, Grid grid, int first, int end):
        cdef int64_t stride = 1
        cdef int j, k
        for j in range(3):
            k = grid.planes.order[j]
            self.range.lo[k] = 0
            self.range.hi[k] = grid.planes.n[k] - 1
            self.stride[k] = stride
            stride *= grid.planes.n[k]
        self.axis = grid.planes.order[2]
        self.range.lo[self.axis] = first
        self.range.hi[self.axis] = end - 1
