"""A ball and all that hangs on it, in the package's order: each ball before its children."""

from libc.math cimport sqrt
from libc.stdint cimport int64_t

import numpy as np

from bfrt.geometry.vector cimport Vec, add, larger, scale, vec

cpdef enum:
    CHILDREN = 9

cdef double RATIO = 1.0 / 3.0  # a child's radius, in its parent's
cdef double UPRIGHT = 0.9999   # a direction whose z is nearer to 1 counts as the z axis

ctypedef fused scalar:
    float
    double

# What turns the z axis, as a row, to a direction: rows.
cdef struct Turn:
    Vec x
    Vec y
    Vec z


cdef inline Turn turn_to(Vec d) noexcept nogil:
    """Turn +z to a direction, about the axis across both; half about y where it is -z."""
    cdef Turn t
    cdef double sine, across, ax, ay
    if d.z >= UPRIGHT:
        t.x, t.y, t.z = vec(1.0, 0.0, 0.0), vec(0.0, 1.0, 0.0), vec(0.0, 0.0, 1.0)
        return t
    if d.z <= -UPRIGHT:
        t.x, t.y, t.z = vec(-1.0, 0.0, 0.0), vec(0.0, 1.0, 0.0), vec(0.0, 0.0, -1.0)
        return t
    sine = sqrt(larger(1.0 - d.z * d.z, 0.0))
    across = sqrt(d.x * d.x + d.y * d.y)
    ax, ay = -d.y / across, d.x / across
    t.x = vec(ax * ax + (1.0 - ax * ax) * d.z, ax * ay * (1.0 - d.z), -ay * sine)
    t.y = vec(ax * ay * (1.0 - d.z), ay * ay + (1.0 - ay * ay) * d.z, ax * sine)
    t.z = vec(ay * sine, -ax * sine, d.z)
    return t


cdef inline Vec turned(const double* v, const Turn* t) noexcept nogil:
    return add(add(scale(t.x, v[0]), scale(t.y, v[1])), scale(t.z, v[2]))


cdef scalar* grow_on(scalar* out, Vec center, Vec direction, double radius, int depth,
                     const double* offsets) noexcept nogil:
    """Write a ball and `depth` generations on it; return where the next one goes."""
    cdef Turn turn
    cdef Vec way
    cdef int child
    out[0] = <scalar>center.x
    out[1] = <scalar>center.y
    out[2] = <scalar>center.z
    out[3] = <scalar>radius
    out += 4
    if depth > 0:
        turn = turn_to(direction)
        for child in range(CHILDREN):
            way = turned(offsets + 3 * child, &turn)
            out = grow_on(out, add(center, scale(way, radius * (1.0 + RATIO))), way,
                          radius * RATIO, depth - 1, offsets)
    return out


def grow(center, direction, double radius, int depth, const double[:, ::1] offsets,
         scalar[:, ::1] records):
    """Write a ball and `depth` generations on it.

    Parameters
    ----------
    center, direction : sequence of 3 float
        Where the ball is, and its direction from its parent.
    offsets : (9, 3) float64
        IN. The directions of children of a ball whose own is +z.
    records : (1 + 9 + ... + 9^depth, 4) float32 or float64
        OUT. Centers and radii.
    """
    cdef Vec c = vec(center[0], center[1], center[2])
    cdef Vec d = vec(direction[0], direction[1], direction[2])
    with nogil:
        grow_on(&records[0, 0], c, d, radius, depth, &offsets[0, 0])


def children(center, direction, double radius, const double[:, ::1] offsets):
    """Return the children of one ball: centers, directions (9, 3) float64, and their radius."""
    cdef Vec c = vec(center[0], center[1], center[2]), way
    cdef Turn turn = turn_to(vec(direction[0], direction[1], direction[2]))
    cdef int64_t child
    cdef double[:, :, ::1] out
    both = np.empty((2, CHILDREN, 3))
    out = both
    for child in range(CHILDREN):
        way = turned(&offsets[child, 0], &turn)
        (<Vec*>&out[0, child, 0])[0] = add(c, scale(way, radius * (1.0 + RATIO)))
        (<Vec*>&out[1, child, 0])[0] = way
    return both[0], both[1], radius * RATIO
