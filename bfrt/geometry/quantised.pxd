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

from bfrt.geometry.box cimport Box, above, box_empty
from bfrt.geometry.packet cimport SIDES, BoxPacket

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

    /* The same for eight boxes, one after another; `in` is 1 for a side that goes up from the
       parent's, -1 for one that goes down. */
    typedef struct {
        float from[BFRT_SIDES];
        float step[BFRT_SIDES];
        float in[BFRT_SIDES];
    } bfrt_codings;

    static inline void bfrt_codings_of(const bfrt_coding *c, bfrt_codings *all)
    {
        for (int i = 0; i < BFRT_BOXES; i++)
            for (int k = 0; k < 6; k++) {
                all->from[6 * i + k] = c->from[k];
                all->step[6 * i + k] = c->step[k];
                all->in[6 * i + k] = k < 3 ? 1.0f : -1.0f;
            }
    }

    /* The codes of the first n of eight boxes; whether any needs another look: one is empty, or
       inside, for steps are all but rounded away. One loop over all sides, for what is nested is
       not vectorized. */
    BFRT_CLONES
    static int bfrt_encode(const bfrt_codings *c, const float *box, int n, uint8_t *code)
    {
        int32_t steps[BFRT_SIDES];
        float side[BFRT_SIDES + 3];
        int look = 0;
        memcpy(side, c->from, sizeof c->from);
        memset(side + BFRT_SIDES, 0, 3 * sizeof *side);
        memcpy(side, box, 6 * n * sizeof *side);
        for (int j = 0; j < BFRT_SIDES; j++) {
            float guess = (side[j] - c->from[j]) / c->step[j];
            guess = guess > 0.0f ? guess : 0.0f;
            int k = (int)(guess < 255.0f ? guess : 255.0f);
            k -= (c->from[j] + (float)k * c->step[j] - side[j]) * c->in[j] > 0.0f;
            k = k < 0 ? 0 : k;
            look |= (c->from[j] + (float)k * c->step[j] - side[j]) * c->in[j] > 0.0f;
            look |= (side[j] > side[j + 3]) & (c->in[j] > 0.0f);
            steps[j] = k;
        }
        for (int j = 0; j < BFRT_SIDES; j++)
            code[j] = (uint8_t)steps[j];
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
                                            BoxPacket* e) noexcept nogil
    ctypedef struct Codings "bfrt_codings":
        pass

    void codings_of "bfrt_codings_of"(const Coding* c, Codings* all) noexcept nogil
    bint encode "bfrt_encode"(const Codings* c, const float* box, int n,
                              uint8_t* code) noexcept nogil
    void coded_union "bfrt_coded_union"(const Coding* c, const uint8_t* code, int n,
                                        float* side) noexcept nogil

cdef enum:
    STEPS = 255


cdef inline void coding_in(const Box* parent, Coding* c) noexcept nogil:
    """Compute the steps by which boxes inside `parent` are coded."""
    cdef float step
    cdef int k
    for k in range(3):
        step = above((<double>parent.hi[k] - parent.lo[k]) / STEPS)
        c.from_[k], c.step[k] = parent.lo[k], step
        c.from_[3 + k], c.step[3 + k] = parent.hi[k], -step


cdef inline int outside(const Coding* c, int side, float x, int steps) noexcept nogil:
    """Lower `steps` until the side that they code is not inside x."""
    cdef float sign = 1.0 if side < 3 else -1.0
    while steps > 0 and sign * (c.from_[side] + <float>steps * c.step[side]) > sign * x:
        steps -= 1
    return steps


cdef inline void codes_of(const Coding* c, const Codings* all, const float* side, int n,
                          uint8_t* code) noexcept nogil:
    """Code n boxes of the parent's, BOXES or fewer, given by their sides."""
    cdef uint8_t own[SIDES]
    cdef int i, k
    if encode(all, side, n, own):
        for i in range(n):
            for k in range(6):
                if box_empty(<const Box*>&side[6 * i]):
                    own[6 * i + k] = STEPS
                else:
                    own[6 * i + k] = <uint8_t>outside(c, k, side[6 * i + k], own[6 * i + k])
    memcpy(code, own, 6 * n)
