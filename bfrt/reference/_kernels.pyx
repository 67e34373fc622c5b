"""The core's inline functions, one call at a time: what tests look at them through."""

from libc.math cimport INFINITY
from libc.stdint cimport int64_t, uint32_t

import numpy as np

from bfrt.geometry.box cimport Box, Span, box_span
from bfrt.geometry.coordinates cimport Frame
from bfrt.geometry.power cimport power as core_power
from bfrt.geometry.shape cimport (
    Meeting, Shape, Surface, shape_bounds, shape_load, shape_meet, shape_surface,
)
from bfrt.geometry.vector cimport Line, Vec, line, vec


def power(const double[::1] x, const double[::1] y):
    """x to the y, (n,) each: `bfrt/geometry/power.pxd`."""
    cdef int64_t i
    cdef double[::1] out = np.empty(x.shape[0])
    for i in range(x.shape[0]):
        out[i] = core_power(x[i], y[i])
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


def spans(const float[:, ::1] boxes, double grow, const double[:, ::1] origins,
          const double[:, ::1] directions):
    """Where each ray is inside the box of its row.

    Parameters
    ----------
    boxes : (n, 6) float32
    grow : float
        What the boxes grow by.
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
        if box_span(&b, grow, &ray, &s):
            out[i, 0], out[i, 1] = s.near, s.far
    return np.asarray(out)


def meet(int kind, const double[::1] record, origin, double grow, const double[:, ::1] origins,
         const double[:, ::1] directions):
    """One object, by float64 record, against rays.

    Parameters
    ----------
    kind : int
    record : (scalars,) float64
        3 a vertex for polygons.
    origin : sequence of 3 float
        Taken off positions.
    grow : float
        What the object's box grows by.
    origins, directions : (n, 3) float64
        Relative to the origin.

    Returns
    -------
    box : (6,) float32
    t : (n,) float64
        inf for a miss.
    surface : (n, 8) float64
        Geometric normal, shading normal, u, v at each hit.
    """
    cdef Frame frame
    cdef Shape shape
    cdef Box b
    cdef Meeting m
    cdef Surface s
    cdef int64_t i
    cdef int k
    cdef double[::1] t = np.full(origins.shape[0], np.inf)
    cdef double[:, ::1] surface = np.full((origins.shape[0], 8), np.nan)
    cdef float[::1] box = np.empty(6, np.float32)
    frame.wide = True
    frame.origin = vec(origin[0], origin[1], origin[2])
    if not shape_load(
        kind, <const unsigned char*>&record[0], <uint32_t>(record.shape[0] // 3), &frame, &shape
    ):
        raise ValueError(f"record: found a degenerate object of kind {kind}, expected another")
    shape_bounds(&shape, &b)
    for k in range(3):
        box[k], box[3 + k] = b.lo[k], b.hi[k]
    for i in range(origins.shape[0]):
        m.line = line_of(origins, directions, i)
        if not box_span(&b, grow, &m.line, &m.span):
            continue
        shape_meet(&shape, &m, 1)
        if m.t < 0.0:
            continue
        t[i] = m.t
        shape_surface(&shape, &m.line, m.t, &s)
        put(surface, i, 0, s.geometric)
        put(surface, i, 3, s.shading)
        surface[i, 6], surface[i, 7] = s.uv.u, s.uv.v
    return np.asarray(box), np.asarray(t), np.asarray(surface)


cdef void put(double[:, ::1] rows, int64_t i, int k, Vec v):
    rows[i, k], rows[i, k + 1], rows[i, k + 2] = v.x, v.y, v.z
