"""Faces of many corners, without the GIL: which are not flat, and triangles of those that need no
ears cut.

A face's plane has Newell's normal, which is twice the face's area long. Seen along it a triangle of
the face's corners has a signed area; where none is negative, the triangles fill the face, and
nothing else.
"""

from libc.math cimport fabs, sqrt
from libc.stdint cimport int64_t, uint8_t, uint32_t

from bfrt.geometry.outline cimport permuted, steepest
from bfrt.geometry.vector cimport Vec, add, cross, dot, largest, scale, sub, unit, vec

import numpy as np

cpdef enum Cut:
    RIGHT  # its triangles fill it
    CROSSING  # they do not, for it crosses itself
    EARS  # it has none so far

ctypedef fused number:
    float
    double

# What rounding makes of an area: a part of the face's, and of the square of its length.
cdef double ROUNDED = 1e-9
cdef double NOTHING = 1e-14

# A part of its area so small that a quadrilateral has its other diagonal where that is better.
cdef double THIN = 1e-6

cdef struct Facing:
    Vec normal  # Newell's
    double sum  # of the areas that make it, at the most twice as large
    double reach  # how far the corners are from the first


cdef inline Vec at(const number[:, ::1] corners, Py_ssize_t i) noexcept nogil:
    return vec(corners[i, 0], corners[i, 1], corners[i, 2])


cdef inline Facing facing_of(const number[:, ::1] corners, Py_ssize_t first,
                             uint32_t count) noexcept nogil:
    cdef Facing f
    cdef Vec a = at(corners, first)
    cdef Vec b = sub(at(corners, first + 1), a)
    cdef Vec c, part
    cdef uint32_t i
    f.normal = vec(0.0, 0.0, 0.0)
    f.sum, f.reach = 0.0, largest(b)
    for i in range(2, count):
        c = sub(at(corners, first + i), a)
        part = cross(b, c)
        f.normal = add(f.normal, part)
        f.sum += largest(part)
        f.reach = max(f.reach, largest(c))
        b = c
    return f


cdef inline bint has_plane(const Facing* f) noexcept nogil:
    """Tell whether a face has a plane: not where its area cancels out, as in a bow tie."""
    return largest(f.normal) > ROUNDED * f.sum


cdef inline bint is_line(const Facing* f) noexcept nogil:
    return f.sum <= NOTHING * f.reach * f.reach


def bent(const number[:, ::1] corners, const uint32_t[::1] counts, double part, double rounding):
    """Tell which faces of four and more corners are not flat.

    Parameters
    ----------
    corners : (m, 3) float32 or float64
        The corners of all faces, one face after the other.
    counts : (n,) uint32
        Corners of each.
    part : float
        How far a corner may be off a flat face's plane, in the distance from the middle of the
        corners to the farthest.
    rounding : float
        How far more it may be off, in its coordinates: in each as much as the plane faces its axis.

    Returns
    -------
    (n,) bool
        A line counts as flat; a face that crosses itself so that it has no plane does not.
    """
    cdef Py_ssize_t face, first = 0
    cdef uint8_t[::1] out
    found = np.zeros(counts.shape[0], np.bool_)
    out = found.view(np.uint8)
    with nogil:
        for face in range(counts.shape[0]):
            if counts[face] > 4 or counts[face] == 4 and not is_level(corners, first, rounding):
                out[face] = is_bent(corners, first, counts[face], part, rounding)
            first += counts[face]
    return found


cdef inline bint is_level(const number[:, ::1] corners, Py_ssize_t first,
                          double rounding) noexcept nogil:
    """Tell whether a quadrilateral is as flat as its first corner is rounded, which most are.

    Its normal is square to both diagonals, so that each corner is as far off as any other.
    """
    cdef Vec a = at(corners, first)
    cdef Vec b = at(corners, first + 1)
    cdef Vec ac = sub(at(corners, first + 2), a)
    cdef Vec bd = sub(at(corners, first + 3), b)
    cdef Vec n = cross(ac, bd)
    cdef double coordinates = fabs(n.x * a.x) + fabs(n.y * a.y) + fabs(n.z * a.z)
    return (
        largest(n) > ROUNDED * largest(ac) * largest(bd)
        and fabs(dot(sub(b, a), n)) <= 2.0 * rounding * coordinates
    )


cdef inline bint is_bent(const number[:, ::1] corners, Py_ssize_t first, uint32_t count,
                         double part, double rounding) noexcept nogil:
    cdef Facing f = facing_of(corners, first, count)
    cdef Vec v
    cdef Vec origin = at(corners, first)
    cdef Vec middle = vec(0.0, 0.0, 0.0)
    cdef Vec n = f.normal
    cdef double off = 0.0, far = 0.0, coordinates = 0.0
    cdef uint32_t i
    if not has_plane(&f):
        return not is_line(&f)
    for i in range(count):
        middle = add(middle, sub(at(corners, first + i), origin))
    middle = add(origin, scale(middle, 1.0 / count))
    for i in range(count):
        v = at(corners, first + i)
        coordinates = max(coordinates, fabs(n.x * v.x) + fabs(n.y * v.y) + fabs(n.z * v.z))
        v = sub(v, middle)
        off = max(off, fabs(dot(v, n)))
        far = max(far, dot(v, v))
    return off > part * sqrt(far * dot(n, n)) + rounding * coordinates


def cut(const number[:, ::1] corners, const uint32_t[::1] counts, int64_t[:, ::1] triangles,
        uint8_t[::1] cuts, double[:, ::1] outlines):
    """Cut faces into triangles where that takes no search: one of k corners into k - 2.

    Parameters
    ----------
    corners, counts
        As of `bent`; each face has three corners or more.
    triangles : (m - 2 n, 3) int64
        OUT. Corners, turning as the face does; of faces that are left nothing.
    cuts : (n,) uint8
        OUT. The `Cut` of each.
    outlines : (m, 2) float64
        OUT. Faces that are left, as they are seen from the side where they turn left.
    """
    cdef Py_ssize_t face, first = 0
    with nogil:
        for face in range(counts.shape[0]):
            cuts[face] = cut_one(corners, first, counts[face], &triangles[first - 2 * face, 0])
            if cuts[face] == EARS:
                look_along(corners, first, counts[face], outlines)
            first += counts[face]


cdef inline Cut cut_one(const number[:, ::1] corners, Py_ssize_t first, uint32_t count,
                        int64_t* out) noexcept nogil:
    cdef Facing f
    if count == 3:
        put_fan(first, 3, 0, out)
        return RIGHT
    f = facing_of(corners, first, 4) if count == 4 else facing_of(corners, first, count)
    if not has_plane(&f) or is_line(&f):
        put_fan(first, count, 0, out)
        return RIGHT if is_line(&f) else CROSSING
    if count == 4:
        return cut_four(corners, first, f.normal, out)
    if not is_fan(corners, first, count, f.normal):
        return EARS
    put_fan(first, count, 0, out)
    return RIGHT


cdef inline void put_fan(Py_ssize_t first, uint32_t count, uint32_t hub,
                         int64_t* out) noexcept nogil:
    """Write the triangles of a face that is a fan around its corner `hub`."""
    cdef uint32_t i
    for i in range(hub + 1, hub + count - 1):
        out[0] = first + hub
        out[1] = first + i % count
        out[2] = first + (i + 1) % count
        out += 3


cdef inline double area(Vec a, Vec b, Vec c, Vec normal) noexcept nogil:
    """Return twice a triangle's area as seen along a normal, times the normal's length."""
    return dot(cross(sub(b, a), sub(c, a)), normal)


cdef Cut cut_four(const number[:, ::1] corners, Py_ssize_t first, Vec normal,
                  int64_t* out) noexcept nogil:
    """Cut along the shorter diagonal, or that which is inside; along the first of equal ones."""
    cdef Vec a = at(corners, first)
    cdef Vec b = at(corners, first + 1)
    cdef Vec c = at(corners, first + 2)
    cdef Vec d = at(corners, first + 3)
    cdef Vec ac = sub(c, a), bd = sub(d, b)
    cdef double whole = dot(normal, normal)
    cdef double along_ac = min(area(a, b, c, normal), area(a, c, d, normal))
    cdef double along_bd = min(area(b, c, d, normal), area(b, d, a, normal))
    cdef bint second = along_bd > along_ac
    if min(along_ac, along_bd) > THIN * whole:
        second = dot(bd, bd) < dot(ac, ac)
    put_fan(first, 4, second, out)
    return RIGHT if max(along_ac, along_bd) >= -ROUNDED * whole else CROSSING


cdef bint is_fan(const number[:, ::1] corners, Py_ssize_t first, uint32_t count,
                 Vec normal) noexcept nogil:
    """Tell whether the corners turn around the first in one direction, by half a turn at most."""
    cdef Vec a = at(corners, first)
    cdef Vec b = at(corners, first + 1)
    cdef Vec c, last = b
    cdef uint32_t i
    for i in range(2, count):
        c = at(corners, first + i)
        if not (area(a, last, c, normal) > 0.0 and area(a, b, c, normal) > 0.0):
            return False
        last = c
    return True


cdef void look_along(const number[:, ::1] corners, Py_ssize_t first, uint32_t count,
                     double[:, ::1] outlines) noexcept nogil:
    """Project a face onto its plane, seen along the axis that is steepest to the plane."""
    cdef Vec n = unit(facing_of(corners, first, count).normal)
    cdef Vec a = at(corners, first)
    cdef Vec v
    cdef int axis = steepest(n)
    cdef double side = 1.0 if permuted(n, axis).z > 0.0 else -1.0
    cdef uint32_t i
    for i in range(count):
        v = sub(at(corners, first + i), a)
        v = permuted(sub(v, scale(n, dot(v, n))), axis)
        outlines[first + i, 0] = side * v.x
        outlines[first + i, 1] = v.y
