"""The marking loop."""

from libc.stdint cimport int64_t, uint8_t

from bfrt.geometry.box cimport Box
from bfrt.grid.regions cimport PacketPlanes, Voxels, eight_voxels, packet_planes, range_at
from bfrt.geometry.packet cimport eight_empty
from bfrt.geometry.box cimport HIGH, LOW
from bfrt.grid.planes cimport START, Planes, Range, entered_by
from bfrt.grid.grid cimport Grid
from bfrt.grid.subspace cimport Subspace
from bfrt.scan.boxes cimport BoxCursor, decode, go_to
from bfrt.scan.scan cimport StreamScan, next_block
from bfrt.streams.atomic cimport atomic_or


cdef enum:
    FACES = (1 << START) - 1
    SMALL = 4  # voxels a side of a range that is marked voxel by voxel


cdef void mark_small(Subspace s, const Range* r, uint8_t* marks) noexcept nogil:
    """Mark a range of few voxels: each of them once, by all faces that begin there."""
    cdef int lo[3]
    cdef int hi[3]
    cdef int k, x, y, z
    cdef int64_t row
    cdef uint8_t faces
    for k in range(3):
        lo[k] = max(r.lo[k], s.range.lo[k])
        hi[k] = min(r.hi[k], s.range.hi[k])
    for z in range(lo[2], hi[2] + 1):
        for y in range(lo[1], hi[1] + 1):
            row = ((y - s.range.lo[1]) * s.stride[1] + (z - s.range.lo[2]) * s.stride[2]
                   - s.range.lo[0] * s.stride[0])
            for x in range(lo[0], hi[0] + 1):
                faces = <uint8_t>entered_by(r, x, y, z) & FACES
                if faces:
                    atomic_or(&marks[row + x * s.stride[0]], faces)


cdef void mark_face(const Planes* g, Subspace s, Range r, int axis, bint high,
                    uint8_t* marks) noexcept nogil:
    """Mark the voxels of one side of a range for rays that enter by that side.

    The range is cut to the subspace when its sides are known, or the subspace's own would be
    marked (rule 10).
    """
    cdef uint8_t bit = <uint8_t>(1 << ((HIGH if high else LOW) + axis))
    cdef int a = g.order[0], b = g.order[1], c = g.order[2]
    cdef int k, i, j, layer
    cdef int64_t row
    if high:
        r.lo[axis] = r.hi[axis]
    else:
        r.hi[axis] = r.lo[axis]
    for k in range(3):
        r.lo[k] = max(r.lo[k], s.range.lo[k])
        r.hi[k] = min(r.hi[k], s.range.hi[k])
    for layer in range(r.lo[c], r.hi[c] + 1):
        for j in range(r.lo[b], r.hi[b] + 1):
            row = (layer - s.range.lo[c]) * s.stride[c] + (j - s.range.lo[b]) * s.stride[b]
            for i in range(r.lo[a] - s.range.lo[a], r.hi[a] - s.range.lo[a] + 1):
                atomic_or(&marks[row + i], bit)


cdef inline bint small(const Range* r) noexcept nogil:
    return (r.hi[0] - r.lo[0] < SMALL and r.hi[1] - r.lo[1] < SMALL
            and r.hi[2] - r.lo[2] < SMALL)


cdef void mark_range(const Planes* g, Subspace s, const Range* r, uint8_t* marks) noexcept nogil:
    """Mark where rays enter a range, as far as that is in the subspace."""
    cdef int axis
    if small(r):
        mark_small(s, r, marks)
        return
    for axis in range(3):
        mark_face(g, s, r[0], axis, False, marks)
        mark_face(g, s, r[0], axis, True, marks)


def mark(StreamScan scan, const int64_t[:, ::1] ranges, const float[:, ::1] parents,
         Grid grid, Subspace subspace, uint8_t[:, :, ::1] marks):
    """Mark where the regions of objects begin, as far as that is in the subspace.

    Parameters
    ----------
    scan : StreamScan
        IN. Set to the first of them.
    ranges : (n, 2) int64
        IN. First and end of runs of objects, ascending, in the scan's window.
    parents : (n, 6) float32, optional
        IN. The box around the objects of each run, where theirs are quantised, of which the marks
        then are.
    marks : (layers, rows, row) uint8
        IN, OUT. The subspace's voxels. Threads may share it.
    """
    cdef BoxCursor b = scan.boxes
    cdef Voxels voxels
    cdef const Box* parent = NULL
    cdef Range region
    cdef PacketPlanes planes
    cdef int i, n
    cdef int64_t k
    if b.coded and parents is None:
        raise ValueError("quantised boxes: found no boxes around them")
    packet_planes(&grid.planes, &planes)
    with nogil:
        for k in range(ranges.shape[0]):
            if b.coded:
                parent = <const Box*>&parents[k, 0]
            go_to(b, ranges, k, parent)
            while b.index < ranges[k, 1]:
                n = next_block(scan, ranges[k, 1] - b.index)
                decode(b, n)
                eight_voxels(&grid.planes, &planes, &b.eight, &voxels)
                for i in range(n):
                    if not eight_empty(&b.eight, i):
                        region = range_at(&voxels, i)
                        mark_range(&grid.planes, subspace, &region, &marks[0, 0, 0])
