"""Coordinates as a geometry file has them: float32, or float64 less the store's origin."""

from bfrt.geometry.vector cimport Vec, vec

cdef struct Frame:
    bint wide    # float64
    Vec origin   # taken off wide coordinates; narrow ones are relative to it already


cdef inline Frame frame_of(bint wide, origin) except *:
    """Return the frame of a file, for a store's origin of 3 float."""
    cdef Frame f
    f.wide, f.origin = wide, vec(origin[0], origin[1], origin[2])
    return f


cdef inline double number(const unsigned char* record, Py_ssize_t i, bint wide) noexcept nogil:
    """Return a record's i-th number. Records are aligned to 4 bytes, read buffers to a page."""
    if wide:
        return (<const double*>record)[i]
    return (<const float*>record)[i]


cdef inline Vec point(const unsigned char* record, Py_ssize_t i, const Frame* f) noexcept nogil:
    """Return the position that starts at the i-th number, less the origin where it is wide."""
    cdef Vec p = direction(record, i, f)
    if f.wide:
        p.x -= f.origin.x
        p.y -= f.origin.y
        p.z -= f.origin.z
    return p


cdef inline Vec direction(const unsigned char* record, Py_ssize_t i, const Frame* f) noexcept nogil:
    """Return the vector that starts at the i-th number, which no origin moves."""
    return vec(
        number(record, i, f.wide), number(record, i + 1, f.wide), number(record, i + 2, f.wide)
    )
