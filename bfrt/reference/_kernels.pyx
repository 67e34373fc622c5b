"""The core's inline functions, one call at a time: what tests look at them through."""

from libc.math cimport INFINITY
from libc.stdint cimport int64_t, uint8_t, uint32_t

import numpy as np

from bfrt.geometry.box cimport Box, Span, box_span
from bfrt.geometry.coordinates cimport Frame, frame_of
from bfrt.geometry.hemisphere cimport Basis, basis_around, cosine_direction
from bfrt.geometry.packet cimport (
    BoxPacket, PaddedPacket, eight_of, eight_pad, eight_span, eight_union,
)
from bfrt.grid.regions cimport PacketPlanes, Voxels, eight_voxels, entered, packet_planes
from bfrt.grid.grid cimport Grid
from bfrt.geometry.power cimport power as core_power
from bfrt.geometry.quantised cimport Coding, coded_union, coding_in, eight_decoded
from bfrt.geometry.shape cimport (
    BoxHit, Shape, Surface, shape_bounds, shape_crossings, shape_load, shape_meet, shape_surface,
)
from bfrt.geometry.sphere cimport sphere_boxes as core_sphere_boxes, sphere_union
from bfrt.geometry.vector cimport Line, Vec, line, vec


def power(const double[::1] x, const double[::1] y):
    """Compute x to the y, (n,) each, by `bfrt/geometry/power.pxd`."""
    cdef int64_t i
    cdef double[::1] out = np.empty(x.shape[0])
    for i in range(x.shape[0]):
        out[i] = core_power(x[i], y[i])
    return np.asarray(out)


def cosine_directions(const double[:, ::1] normals, const double[::1] u, const double[::1] v):
    """Make directions around unit normals, (n, 3), from numbers (n,), by `hemisphere.pxd`."""
    cdef int64_t i
    cdef Basis around
    cdef double[:, ::1] out = np.empty((u.shape[0], 3))
    for i in range(u.shape[0]):
        around = basis_around(vec(normals[i, 0], normals[i, 1], normals[i, 2]))
        put(out, i, 0, cosine_direction(&around, u[i], v[i]))
    return np.asarray(out)


cdef Line line_of(const double[:, ::1] origins, const double[:, ::1] directions, int64_t i):
    return line(
        vec(origins[i, 0], origins[i, 1], origins[i, 2]),
        vec(directions[i, 0], directions[i, 1], directions[i, 2]),
    )


cdef Box box_of(const float[:, ::1] boxes, int64_t i):
    cdef Box b
    cdef int k
    for k in range(3):
        b.lo[k] = boxes[i, k]
        b.hi[k] = boxes[i, 3 + k]
    return b


def spans(const float[:, ::1] boxes, double padding, const double[:, ::1] origins,
          const double[:, ::1] directions):
    """Find where each ray is inside the box of its row.

    Parameters
    ----------
    boxes : (n, 6) float32
    padding : float
        The length by which boxes are padded.
    origins, directions : (n, 3) float64

    Returns
    -------
    (n, 2) float64
        near and far; inf and -inf for nowhere.
    """
    cdef double[:, ::1] out = np.empty((boxes.shape[0], 2))
    cdef int64_t i
    cdef Box b
    cdef Line ray
    cdef Span s
    for i in range(boxes.shape[0]):
        b = box_of(boxes, i)
        ray = line_of(origins, directions, i)
        out[i, 0], out[i, 1] = INFINITY, -INFINITY
        if box_span(&b, padding, &ray, &s):
            out[i, 0], out[i, 1] = s.near, s.far
    return np.asarray(out)


def spans_of_eight(const float[:, ::1] boxes, double padding, const double[:, ::1] origins,
                   const double[:, ::1] directions, double reach=INFINITY):
    """Find where each ray is inside each of up to eight boxes, tested together.

    Parameters
    ----------
    boxes : (m, 6) float32
    padding, origins, directions
        As for `spans`.

    Returns
    -------
    spans : (n, 8, 2) float64
        near and far; near > far for nowhere.
    met : (n,) uint8
        As bits, the boxes that it comes into no later than at `reach`.
    """
    cdef double[:, :, ::1] out = np.empty((origins.shape[0], 2, 8))
    cdef uint8_t[::1] met = np.empty(origins.shape[0], np.uint8)
    cdef double inv[3]
    cdef BoxPacket eight
    cdef PaddedPacket padded
    cdef int64_t i
    eight_of(&boxes[0, 0], <int>boxes.shape[0], &eight)
    eight_pad(&eight, padding, &padded)
    for i in range(origins.shape[0]):
        met[i] = <uint8_t>eight_span(
            &padded, &origins[i, 0], &directions[i, 0], reach, &inv[0], &out[i, 0, 0], &out[i, 1, 0]
        )
    return np.swapaxes(np.asarray(out), 1, 2), np.asarray(met)


def voxels_of_eight(const float[:, ::1] boxes, Grid grid):
    """Find the voxels of up to eight boxes, worked out together, and the box around all.

    Parameters
    ----------
    boxes : (m, 6) float32
    grid : Grid

    Returns
    -------
    voxels : (8, 6) int32
        From and to; of empty boxes, and beyond the last, a range that nothing is in.
    around : (6,) float32
    """
    cdef int[:, ::1] out = np.empty((6, 8), np.int32)
    cdef float[::1] around = np.empty(6, np.float32)
    cdef BoxPacket eight
    cdef PacketPlanes planes
    eight_of(&boxes[0, 0], <int>boxes.shape[0], &eight)
    eight_union(&eight, &around[0])
    packet_planes(&grid.planes, &planes)
    eight_voxels(&grid.planes, &planes, &eight, <Voxels*>&out[0, 0])
    return np.asarray(out).T, np.asarray(around)


def decoded_eight(const float[::1] parent, const uint8_t[:, ::1] codes):
    """Decode up to eight quantised boxes, and the box around all.

    Parameters
    ----------
    parent : (6,) float32
        In which they are quantised.
    codes : (m, 6) uint8

    Returns
    -------
    boxes : (8, 6) float32
        Empty ones beyond the last.
    around : (6,) float32
    """
    cdef float[:, ::1] out = np.empty((6, 8), np.float32)
    cdef float[::1] around = np.empty(6, np.float32)
    cdef Coding coding
    cdef int n = <int>codes.shape[0]
    coding_in(<const Box*>&parent[0], &coding)
    eight_decoded(&coding, &codes[0, 0], n, <BoxPacket*>&out[0, 0])
    coded_union(&coding, &codes[0, 0], n, &around[0])
    return np.asarray(out).T, np.asarray(around)


def entered_of_eight(const int[:, ::1] regions, const int[:, ::1] voxels,
                     const uint8_t[::1] faces):
    """Find which of eight regions a ray enters that comes into a voxel by a face.

    Parameters
    ----------
    regions : (6, 8) int32
        Their voxels, from and to.
    voxels : (n, 3) int32
    faces : (n,) uint8

    Returns
    -------
    (n,) uint8
        A bit each.
    """
    cdef uint8_t[::1] out = np.empty(voxels.shape[0], np.uint8)
    entered(
        <const Voxels*>&regions[0, 0], <int>voxels.shape[0], <const int (*)[3]>&voxels[0, 0],
        &faces[0], &out[0],
    )
    return np.asarray(out)


def sphere_boxes(const uint8_t[:, ::1] records, bint wide, origin):
    """Compute the boxes of up to eight spheres, worked out together.

    Parameters
    ----------
    records : (n, 16 or 32) uint8
        Records of four float32 each, or of four float64.
    origin : sequence of 3 float
        Taken off the positions of wide records.

    Returns
    -------
    boxes : (8, 6) float32
        Empty ones beyond the last.
    around : (6,) float32
        Around all of them, and the positions of those that are degenerate.
    """
    cdef float[:, ::1] out = np.empty((6, 8), np.float32)
    cdef float[::1] around = np.empty(6, np.float32)
    cdef Frame frame
    cdef int n = <int>records.shape[0]
    frame = frame_of(wide, origin)
    core_sphere_boxes(&records[0, 0], records.shape[1], &frame, n, <BoxPacket*>&out[0, 0])
    sphere_union(&records[0, 0], records.shape[1], &frame, n, <Box*>&around[0])
    return np.ascontiguousarray(np.asarray(out).T), np.asarray(around)


def meet(int kind, const double[::1] record, origin, double padding, const double[:, ::1] origins,
         const double[:, ::1] directions):
    """Test one object, given as a float64 record, against rays.

    Parameters
    ----------
    kind : int
    record : (scalars,) float64
        3 a vertex for polygons.
    origin : sequence of 3 float
        Taken off positions.
    padding : float
        The length by which the object's box is padded.
    origins, directions : (n, 3) float64
        Relative to the origin.

    Returns
    -------
    box : (6,) float32
    t : (n,) float64
        inf for a miss.
    surface : (n, 11) float64
        Geometric normal, shading normal, u, v, place at each hit.
    crossings : (n,) int64
        Number of crossings that the object owns.
    """
    cdef Frame frame
    cdef Shape shape
    cdef Box b
    cdef BoxHit m
    cdef Surface s
    cdef int64_t i
    cdef int k
    cdef double[::1] t = np.full(origins.shape[0], np.inf)
    cdef double[:, ::1] surface = np.full((origins.shape[0], 11), np.nan)
    cdef int64_t[::1] crossings = np.zeros(origins.shape[0], np.int64)
    cdef double crossing[2]
    cdef float[::1] box = np.empty(6, np.float32)
    frame = frame_of(True, origin)
    if not shape_load(
        kind, <const unsigned char*>&record[0], <uint32_t>(record.shape[0] // 3), &frame, &shape
    ):
        raise ValueError(f"record: found a degenerate object of kind {kind}, expected another")
    shape_bounds(&shape, &b)
    for k in range(3):
        box[k], box[3 + k] = b.lo[k], b.hi[k]
    for i in range(origins.shape[0]):
        m.line = line_of(origins, directions, i)
        if not box_span(&b, padding, &m.line, &m.span):
            continue
        crossings[i] = shape_crossings(&shape, &m.line, &m.span, &crossing[0])
        shape_meet(&shape, &m, 1)
        if m.t < 0.0:
            continue
        t[i] = m.t
        shape_surface(&shape, &m.line, m.t, &s)
        put(surface, i, 0, s.geometric)
        put(surface, i, 3, s.shading)
        surface[i, 6], surface[i, 7] = s.uv.u, s.uv.v
        put(surface, i, 8, s.place)
    return np.asarray(box), np.asarray(t), np.asarray(surface), np.asarray(crossings)


cdef void put(double[:, ::1] rows, int64_t i, int k, Vec v):
    rows[i, k], rows[i, k + 1], rows[i, k + 2] = v.x, v.y, v.z
