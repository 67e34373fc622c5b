"""Boxes quantised inside the box around them: a byte a side, rounded outwards.

::

    parent     lo |-----------------------------------------| hi       255 steps
    box                 |==================|
    code         a steps|                  |b steps                    box.lo >= lo + a step
                                                                       box.hi <= hi - b step

A box that is read back is never smaller than it was, and on each side by less than a step larger.
Sums are float32 wherever they are made, so that what was checked when a box was written is true
when it is read. What has no point becomes something of no more than a step: who needs to know has
the object itself.
"""

from bfrt.geometry.box cimport Box, Grown, above, box_empty
from bfrt.geometry.vector cimport larger, smaller

cdef extern from *:
    """
    #include <stdint.h>

    enum { BFRT_CODED = 8 };

    typedef struct {
        float from[6 * BFRT_CODED];  /* the parent's sides, for each of eight boxes */
        float step[6 * BFRT_CODED];
    } bfrt_coding;

    /* The sides of the first n boxes. */
    static inline void bfrt_decode(const bfrt_coding *c, const uint8_t *code, int n, float *side)
    {
        for (int j = 0; j < 6 * n; j++)
            side[j] = c->from[j] + (float)code[j] * c->step[j];
    }
    """
    ctypedef struct Coding "bfrt_coding":
        float from_ "from"[48]
        float step[48]

    void decode "bfrt_decode"(const Coding* c, const unsigned char* code, int n,
                              float* side) noexcept nogil

cdef enum:
    CODE_BYTES = 6
    STEPS = 255


cdef inline void coding_in(const Box* parent, Coding* c) noexcept nogil:
    """How boxes inside that one are coded."""
    cdef float step
    cdef int i, k
    for k in range(3):
        step = above((<double>parent.hi[k] - parent.lo[k]) / STEPS)
        for i in range(8):
            c.from_[6 * i + k] = parent.lo[k]
            c.step[6 * i + k] = step
            c.from_[6 * i + 3 + k] = parent.hi[k]
            c.step[6 * i + 3 + k] = -step


cdef inline void boxes_of(const Coding* c, const unsigned char* code, int n,
                          Box* boxes) noexcept nogil:
    """Up to eight boxes."""
    decode(c, code, n, &boxes[0].lo[0])


cdef inline void innermost(const Coding* c, const Box* coded, Grown* b) noexcept nogil:
    """Sides that those of the box that was coded lie between, and its own.

    A step further for the rounding of the sums.
    """
    cdef int k
    for k in range(3):
        b.lo[k] = coded.lo[k] + 2.0 * c.step[k]
        b.hi[k] = coded.hi[k] + 2.0 * c.step[3 + k]


cdef inline float side_of(const Coding* c, int side, int code) noexcept nogil:
    return c.from_[side] + <float>code * c.step[side]


cdef inline unsigned char code_of(const Coding* c, int side, float x) noexcept nogil:
    """The largest that does not go beyond x: above it on a low side, below it on a high one."""
    cdef float sign = 1.0 if side < 3 else -1.0
    cdef double guess
    cdef int code
    if c.step[side] == 0.0:
        return 0
    guess = (<double>x - c.from_[side]) / c.step[side]
    code = <int>smaller(larger(guess, 0.0), STEPS)
    while code > 0 and sign * side_of(c, side, code) > sign * x:
        code -= 1
    while code < STEPS and sign * side_of(c, side, code + 1) <= sign * x:
        code += 1
    return <unsigned char>code


cdef inline void encode(const Coding* c, const Box* b, unsigned char* code) noexcept nogil:
    """Code a box of the parent's."""
    cdef int k
    for k in range(3):
        code[k] = STEPS if box_empty(b) else code_of(c, k, b.lo[k])
        code[3 + k] = STEPS if box_empty(b) else code_of(c, 3 + k, b.hi[k])
