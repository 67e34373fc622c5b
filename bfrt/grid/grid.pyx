"""Voxel planes of a grid, and walks through it as tests and tools see them."""

cimport cython
from libc.stdint cimport int64_t, uint32_t

import numpy as np

from bfrt.geometry.box cimport Box
from bfrt.grid.planes cimport NOWHERE, Range, box_range
from bfrt.grid.walk cimport Walk, walk_leave, walk_resume, walk_start, walk_step
from bfrt.geometry.vector cimport Line, line, vec


@cython.final
cdef class Grid:
    """Describes a uniform grid of nx x ny x nz voxels.

    Parameters
    ----------
    lo, hi : sequence of 3 float
        Bounds of the objects' boxes, relative to the store's origin. The grid reaches a little
        further: over all boxes padded by 2 d (exactness rule 5).
    shape : tuple of 3 int
        Voxels on each axis.
    padding : float
        d, the length by which boxes are padded when a ray meets them.
    axis : int
        Along which the grid is cut into slabs.
    """

    def __cinit__(self, lo, hi, shape, double padding, int axis=2):
        cdef const double[::1] planes
        cdef int k
        cdef double first, last
        cdef int64_t stride = 1
        self.shape = tuple(shape)
        self.order = (*(k for k in range(3) if k != axis), axis)
        for j, k in enumerate(self.order):
            self.planes.order[j] = k
            self.planes.stride[k] = stride
            stride *= self.shape[k]
        self.padding = padding
        self.tables = []
        self.planes.padding = padding
        for k in range(3):
            first = lo[k] - 4.0 * padding
            last = hi[k] + 4.0 * padding
            table = first + (last - first) * (np.arange(shape[k] + 1) / shape[k])
            table[shape[k]] = last
            table.flags.writeable = False
            planes = table
            self.tables.append(table)
            self.planes.n[k] = shape[k]
            self.planes.plane[k] = &planes[0]
            self.planes.inverse[k] = shape[k] / (last - first)
            self.planes.slack[k] = shape[k] * 2.0**-48 + self.planes.inverse[k] * (
                2.0 * padding + 2.0**-48 * (abs(first) + abs(last))
            )

    @property
    def layered(self):
        """Return the voxels an axis by descending strides: (layers, rows, row)."""
        return tuple(self.shape[k] for k in self.order[::-1])

    @property
    def voxels(self):
        """Return the number of voxels."""
        return self.shape[0] * self.shape[1] * self.shape[2]

    def range_of(self, box):
        """Return the voxels (lo, hi), inclusive, of a float32 box (6,)."""
        cdef Box b
        cdef Range r
        cdef int k
        for k in range(3):
            b.lo[k] = box[k]
            b.hi[k] = box[3 + k]
        box_range(&self.planes, &b, &r)
        return (r.lo[0], r.lo[1], r.lo[2]), (r.hi[0], r.hi[1], r.hi[2])

    def walk(self, origin, direction, uint32_t voxel=NOWHERE, int face=0, int shift=0):
        """Return the voxels that a ray goes through: a list of (voxel, face, t of entry).

        With `voxel` and `face` the walk is taken up there, as from a stored state. With `shift`
        it goes from cube to cube of 2^shift voxels a side, to the first voxel in each.
        """
        cdef Walk w
        cdef Line l = line(
            vec(origin[0], origin[1], origin[2]), vec(direction[0], direction[1], direction[2])
        )
        if voxel != NOWHERE:
            walk_resume(&w, &self.planes, &l, voxel, face)
        elif not walk_start(&w, &self.planes, &l):
            return []
        way = [(w.voxel, w.face, w.enter)]
        while walk_leave(&w, shift) if shift else walk_step(&w):
            way.append((w.voxel, w.face, w.enter))
        return way
