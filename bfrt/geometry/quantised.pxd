"""Boxes quantised inside the box around them: a byte a side, rounded outwards.

::

    parent     lo |-----------------------------------------| hi       255 steps
    box                 |==================|
    code         a steps|                  |b steps                    box.lo >= lo + a step
                                                                       box.hi <= hi - b step

A box that is read back is never smaller than it was, and on each side by less than two steps
larger. Sums are float32 wherever they are made, so that what was checked when a box was written is
true when it is read. What has no point becomes something of no more than a step: who needs to know
has the object itself.
"""

from bfrt.geometry.box cimport Box, above, box_empty
from bfrt.geometry.lanes cimport BOXES, Coding, decode, encode

cdef enum:
    STEPS = 255


cdef inline void coding_in(const Box* parent, Coding* c) noexcept nogil:
    """How boxes inside that one are coded."""
    cdef float step
    cdef int i, k
    for k in range(3):
        step = above((<double>parent.hi[k] - parent.lo[k]) / STEPS)
        for i in range(BOXES):
            c.from_[6 * i + k] = parent.lo[k]
            c.step[6 * i + k] = step
            c.from_[6 * i + 3 + k] = parent.hi[k]
            c.step[6 * i + 3 + k] = -step


cdef inline void boxes_of(const Coding* c, const unsigned char* code, int n,
                          Box* boxes) noexcept nogil:
    """The first n boxes, BOXES or fewer."""
    decode(c, code, n, &boxes[0].lo[0])


cdef inline unsigned char outside(const Coding* c, int side, float x,
                                  unsigned char code) noexcept nogil:
    """The code, or as much less that its side is not inside x."""
    cdef float sign = 1.0 if side < 3 else -1.0
    while code > 0 and sign * (c.from_[side] + <float>code * c.step[side]) > sign * x:
        code -= 1
    return code


cdef inline void codes_of(const Coding* c, const Box* boxes, int n,
                          unsigned char* code) noexcept nogil:
    """Code the first n boxes of the parent's, BOXES or fewer."""
    cdef int i, k
    cdef bint off = encode(c, &boxes[0].lo[0], n, code)
    for i in range(n):
        for k in range(6):
            if box_empty(&boxes[i]):
                code[6 * i + k] = STEPS
            elif off:
                code[6 * i + k] = outside(c, k, (&boxes[i].lo[0])[k], code[6 * i + k])
