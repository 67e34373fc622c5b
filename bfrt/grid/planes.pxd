"""The planes of a uniform grid, by one table an axis, and the voxels of boxes (exactness rules 2, 3
and 5).

::

    face of entry, in the ray's own words        voxel index
      LOW  + axis: moving up, by the low face      x, y, z times their strides; that of the slabs'
      HIGH + axis: moving down, by the high face   axis is the longest, so that the voxels of a
      START: the walk begins inside                slab follow each other

Where a ray crosses a plane is walk.pxd's.
"""

from libc.stdint cimport int64_t, uint32_t

from bfrt.geometry.box cimport HIGH, LOW, Box
from bfrt.geometry.vector cimport larger, smaller

cdef extern from *:
    """
    enum { BFRT_START = 6 };  /* the face of a walk that begins inside: no side of a box */
    """
    enum:
        START "BFRT_START"

cdef enum:
    NOWHERE = 0xFFFFFFFF  # a voxel that is none: the walk has left the grid

cdef struct Planes:
    int n[3]
    int order[3]            # axes, from that of the shortest stride to the slabs'
    int64_t stride[3]       # of a voxel's number, an axis
    const double* plane[3]  # n + 1 of them an axis, ascending
    double inverse[3]       # voxels per length
    double padding             # d, by which boxes are padded when rays meet them
    double slack[3]         # voxels by which arithmetic may differ from the table, and 2d

cdef struct Range:
    int lo[3]
    int hi[3]  # inclusive

cdef inline int layer_of(const Planes* g, int k, uint32_t voxel) noexcept nogil:
    """Return the index of a voxel along an axis."""
    return <int>(voxel // <uint32_t>g.stride[k] % <uint32_t>g.n[k])


cdef inline int locate(const Planes* g, int k, double x) noexcept nogil:
    """Return the voxel of axis k that holds x, by the table; clamped to the grid."""
    cdef const double* plane = g.plane[k]
    cdef int last = g.n[k] - 1
    cdef double guess = (x - plane[0]) * g.inverse[k]
    cdef int i = 0
    if guess >= last:
        i = last
    elif guess > 0.0:
        i = <int>guess
    while i > 0 and plane[i] > x:
        i -= 1
    while i < last and plane[i + 1] <= x:
        i += 1
    return i


cdef inline int roughly(const Planes* g, int k, double x, double slack) noexcept nogil:
    """Return the voxel of axis k that holds x, by arithmetic, moved by `slack` voxels."""
    cdef double guess = (x - g.plane[k][0]) * g.inverse[k] + slack
    return <int>smaller(larger(guess, 0.0), g.n[k] - 1)


cdef inline Range rough_range(const Planes* g, const Box* b) noexcept nogil:
    """Return the voxels that a box may touch: by arithmetic, never one less."""
    cdef Range r
    cdef int k
    for k in range(3):
        r.lo[k] = roughly(g, k, b.lo[k], -g.slack[k])
        r.hi[k] = roughly(g, k, b.hi[k], g.slack[k])
    return r


cdef inline int located(const Planes* g, int k, double x) noexcept nogil:
    """Return what `locate` does; the table is asked only where arithmetic may differ from it."""
    cdef int low = roughly(g, k, x, -g.slack[k])
    return low if low == roughly(g, k, x, g.slack[k]) else locate(g, k, x)


cdef inline void box_range(const Planes* g, const Box* b, Range* r) noexcept nogil:
    """Find the voxels of the box padded by 2d (rule 3)."""
    cdef int k
    for k in range(3):
        r.lo[k] = located(g, k, b.lo[k] - 2.0 * g.padding)
        r.hi[k] = located(g, k, b.hi[k] + 2.0 * g.padding)


cdef inline int entered_by(const Range* r, int x, int y, int z) noexcept nogil:
    """Return the faces, as bits, by which a ray comes into the range at a voxel of it.

    START always counts: the walk began inside.
    """
    return (
        1 << START
        | (x == r.lo[0]) << LOW | (x == r.hi[0]) << HIGH
        | (y == r.lo[1]) << (LOW + 1) | (y == r.hi[1]) << (HIGH + 1)
        | (z == r.lo[2]) << (LOW + 2) | (z == r.hi[2]) << (HIGH + 2)
    )
