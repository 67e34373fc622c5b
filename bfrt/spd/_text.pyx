"""Objects as lines of NFF: six digits a number, as C's %g gives them, without the GIL."""

from libc.stdint cimport int64_t, uint32_t
from libc.stdio cimport snprintf
from libc.string cimport memcpy

import numpy as np

from bfrt.records cimport CONE, KINDS, PATCH, POLYGON, SPHERE

cdef enum:
    NUMBER = 16   # bytes of a number and what divides it from the next, at the most
    OBJECT = 32   # of an object beside its numbers

# The objects of one kind in a block; for polygons where each begins, in vertices.
cdef struct Column:
    int kind
    const double* records
    const int64_t* starts


cdef inline char* number(char* p, double x, char after) noexcept nogil:
    p += snprintf(p, NUMBER, b"%g", x)
    p[0] = after
    return p + 1


cdef inline char* numbers(char* p, const double* x, int n) noexcept nogil:
    """Write n numbers on a line."""
    cdef int i
    for i in range(n):
        p = number(p, x[i], b"\n" if i + 1 == n else b" ")
    return p


cdef char* outline(char* p, const double* x, int64_t n) noexcept nogil:
    """Write a polygon: the number of its vertices, then the vertices, a line each."""
    cdef int64_t i
    p += snprintf(p, OBJECT, b"p %lld\n", <long long>n)
    for i in range(n):
        p = numbers(p, x + 3 * i, 3)
    return p


cdef char* patch(char* p, const double* x) noexcept nogil:
    """Write a patch: three vertices, each with its normal."""
    cdef int i, k
    memcpy(p, b"pp 3\n", 5)
    p += 5
    for i in range(3):
        for k in range(3):
            p = number(p, x[3 * i + k], b" ")
        p = numbers(p, x + 9 + 3 * i, 3)
    return p


cdef inline char* lettered(char* p, char letter, const double* x, int n) noexcept nogil:
    p[0] = letter
    p[1] = b" "
    return numbers(p + 2, x, n)


cdef char* line(char* p, const Column* c, int64_t i) noexcept nogil:
    """Write the i-th object of a column."""
    if c.kind == SPHERE:
        return lettered(p, b"s", c.records + 4 * i, 4)
    if c.kind == CONE:
        return lettered(p, b"c", c.records + 8 * i, 8)
    if c.kind == PATCH:
        return patch(p, c.records + 18 * i)
    if c.kind == POLYGON:
        return outline(p, c.records + 3 * c.starts[i], c.starts[i + 1] - c.starts[i])
    return outline(p, c.records + 9 * i, 3)


def lines(columns, const int64_t[::1] owner, const int64_t[::1] index,
          const uint32_t[::1] materials, fills):
    """Return the text of a block.

    Parameters
    ----------
    columns : sequence of (int, (m,) float64, (n + 1,) int64)
        The kind of each, the numbers of its objects, and where each polygon begins, in vertices:
        not used for other kinds.
    owner, index : (objects,) int64
        Which column each object is in, and where.
    materials : (objects,) uint32
        Their materials: `fills` of one stands before the first object, and before each whose
        material is another than that of the one before.
    fills : sequence of bytes

    Returns
    -------
    bytes
    """
    cdef Column c[KINDS]
    cdef const double[::1] records
    cdef const int64_t[::1] starts
    cdef const unsigned char[::1] fill_text = np.frombuffer(b"".join(fills) + b"\n", np.uint8)
    cdef const int64_t[::1] fill_at = np.cumsum([0, *map(len, fills)])
    cdef int64_t i, current = -1, total = 0, n = owner.shape[0], longest = max(map(len, fills))
    cdef int k
    cdef char* p
    if len(columns) > KINDS:
        raise ValueError(f"lines: found {len(columns)} columns, expected {KINDS} at the most")
    for k in range(len(columns)):
        c[k].kind, records, starts = columns[k]
        c[k].records = &records[0] if records.shape[0] else NULL
        c[k].starts = &starts[0]
        total += records.shape[0]
    changes = int(np.count_nonzero(np.diff(materials, prepend=current)))
    out = np.empty(total * NUMBER + n * OBJECT + changes * longest, np.uint8)
    cdef unsigned char[::1] buffer = out
    if n == 0:
        return b""
    p = <char*>&buffer[0]
    with nogil:
        for i in range(n):
            if materials[i] != current:
                current = materials[i]
                longest = fill_at[current + 1] - fill_at[current]
                memcpy(p, &fill_text[fill_at[current]], longest)
                p += longest
            p = line(p, &c[owner[i]], index[i])
    return out[:p - <char*>&buffer[0]].tobytes()
