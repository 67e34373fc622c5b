"""Boxes quantised inside the box around them: a byte a side, rounded outwards.

::

    parent     lo |-----------------------------------------| hi       255 steps
    box                 |==================|
    code         a steps|                  |b steps                    box.lo >= lo + a step
                                                                       box.hi <= hi - b step

A box that is read back is never smaller than it was, and on each side by less than two steps
larger. Sums are float32 wherever they are made, so that what was checked when a box was written is
true when it is read. What has no point is coded as the parent turned inside out: that is empty too,
but where the parent is one point. Who needs to know has the object itself.
"""

from libc.stdint cimport uint8_t
from libc.string cimport memcpy

from bfrt.geometry.box cimport Box, above
from bfrt.geometry.eight cimport SIDES, Eight, eight_empty

cdef extern from *:
    """
    /* The sides that hold the boxes, and a step inwards from each. */
    typedef struct {
        float from[6];
        float step[6];
    } bfrt_coding;

    /* The first n boxes. */
    BFRT_CLONES
    static void bfrt_eight_decoded(const bfrt_coding *c, const uint8_t *code, int n, bfrt_eight *e)
    {
        uint8_t turned[6][BFRT_BOXES] = {{0}};
        for (int i = 0; i < n; i++)
            for (int k = 0; k < 6; k++)
                turned[k][i] = code[6 * i + k];
        for (int k = 0; k < 6; k++) {
            float from = c->from[k], step = c->step[k];
            for (int i = 0; i < BFRT_BOXES; i++)
                e->side[k][i] = from + (float)turned[k][i] * step;
        }
        bfrt_eight_end(e, n);
    }

    /* The codes of eight boxes; whether any needs another look: one is empty, or inside, for steps
       are all but rounded away. One loop over all sides, for what is nested is not vectorized. */
    BFRT_CLONES
    static int bfrt_encode(const bfrt_coding *c, const bfrt_eight *e, uint8_t *code)
    {
        int32_t steps[BFRT_SIDES];
        float from[BFRT_SIDES], step[BFRT_SIDES], in[BFRT_SIDES];
        const float *side = &e->side[0][0];
        int look = 0;
        for (int k = 0; k < 6; k++)
            for (int i = 0; i < BFRT_BOXES; i++) {
                from[BFRT_BOXES * k + i] = c->from[k];
                step[BFRT_BOXES * k + i] = c->step[k];
                in[BFRT_BOXES * k + i] = k < 3 ? 1.0f : -1.0f;
            }
        for (int j = 0; j < BFRT_SIDES; j++) {
            float guess = (side[j] - from[j]) / step[j];
            guess = guess > 0.0f ? guess : 0.0f;
            int n = (int)(guess < 255.0f ? guess : 255.0f);
            n -= (from[j] + (float)n * step[j] - side[j]) * in[j] > 0.0f;
            n = n < 0 ? 0 : n;
            look |= (from[j] + (float)n * step[j] - side[j]) * in[j] > 0.0f;
            steps[j] = n;
        }
        for (int j = 0; j < BFRT_SIDES / 2; j++)
            look |= side[j] > side[BFRT_SIDES / 2 + j];
        for (int i = 0; i < BFRT_BOXES; i++)
            for (int k = 0; k < 6; k++)
                code[6 * i + k] = (uint8_t)steps[BFRT_BOXES * k + i];
        return look;
    }

    /* The box around the first n boxes: fewer steps are further out. */
    static inline void bfrt_coded_union(const bfrt_coding *c, const uint8_t *code, int n,
                                        float *side)
    {
        enum { ROOM = 8 };
        uint8_t own[BFRT_SIDES + 2], least[ROOM];
        memset(own, 255, sizeof own);
        memcpy(own, code, 6 * n);
        memset(least, 255, sizeof least);
        for (int i = 0; i < BFRT_BOXES; i++)
            for (int k = 0; k < ROOM; k++) /* two more than there are, so that it is one vector */
                least[k] = own[6 * i + k] < least[k] ? own[6 * i + k] : least[k];
        for (int k = 0; k < 6; k++)
            side[k] = c->from[k] + (float)least[k] * c->step[k];
    }
    """
    ctypedef struct Coding "bfrt_coding":
        float from_ "from"[6]
        float step[6]

    void eight_decoded "bfrt_eight_decoded"(const Coding* c, const uint8_t* code, int n,
                                            Eight* e) noexcept nogil
    bint encode "bfrt_encode"(const Coding* c, const Eight* e, uint8_t* code) noexcept nogil
    void coded_union "bfrt_coded_union"(const Coding* c, const uint8_t* code, int n,
                                        float* side) noexcept nogil

cdef enum:
    STEPS = 255


cdef inline void coding_in(const Box* parent, Coding* c) noexcept nogil:
    """How boxes inside that one are coded."""
    cdef float step
    cdef int k
    for k in range(3):
        step = above((<double>parent.hi[k] - parent.lo[k]) / STEPS)
        c.from_[k], c.step[k] = parent.lo[k], step
        c.from_[3 + k], c.step[3 + k] = parent.hi[k], -step


cdef inline int outside(const Coding* c, int side, float x, int steps) noexcept nogil:
    """The steps, or as much less that the side is not inside x."""
    cdef float sign = 1.0 if side < 3 else -1.0
    while steps > 0 and sign * (c.from_[side] + <float>steps * c.step[side]) > sign * x:
        steps -= 1
    return steps


cdef inline void codes_of(const Coding* c, const Eight* e, int n, uint8_t* code) noexcept nogil:
    """Code the first n boxes of the parent's, BOXES or fewer."""
    cdef uint8_t own[SIDES]
    cdef int i, k
    if encode(c, e, own):
        for i in range(n):
            for k in range(6):
                if eight_empty(e, i):
                    own[6 * i + k] = STEPS
                else:
                    own[6 * i + k] = <uint8_t>outside(c, k, e.side[k][i], own[6 * i + k])
    memcpy(code, own, 6 * n)
