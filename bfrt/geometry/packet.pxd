"""Eight boxes side by side in vector lanes: the work of box.pxd, for one line and eight at a time.

::

    side    [LOW + axis], [HIGH + axis], of each of the eight
    empty   lo > hi on some axis; so are those beyond the last, where there are fewer

The other way round, one box against many lines, is lanes.pxd's, whose BFRT_CLONES and whose
promise of the same bits hold here too.
"""

from libc.math cimport INFINITY
from libc.stdint cimport uint8_t

from bfrt.geometry.box cimport HIGH, PaddedBox
from bfrt.geometry.lanes cimport LANES  # and its BFRT_CLONES

cdef extern from *:
    """
    #include <stdint.h>
    #include <string.h>

    enum { BFRT_BOXES = 8, BFRT_SIDES = 6 * BFRT_BOXES };

    typedef struct {
        float side[6][BFRT_BOXES];
    } bfrt_eight;

    static inline int bfrt_eight_empty(const bfrt_eight *e, int i)
    {
        return e->side[0][i] > e->side[3][i] || e->side[1][i] > e->side[4][i]
            || e->side[2][i] > e->side[5][i];
    }

    /* From so many on they are empty. */
    static inline void bfrt_eight_end(bfrt_eight *e, int n)
    {
        for (int k = 0; k < 6; k++)
            for (int i = n; i < BFRT_BOXES; i++)
                e->side[k][i] = k < 3 ? INFINITY : -INFINITY;
    }

    /* The first n of eight boxes, from one side to the next of each. */
    static inline void bfrt_eight_of(const float *side, int n, bfrt_eight *e)
    {
        for (int i = 0; i < n; i++)
            for (int k = 0; k < 6; k++)
                e->side[k][i] = side[6 * i + k];
        bfrt_eight_end(e, n);
    }

    /* The box around the eight: empty if they are. */
    BFRT_CLONES
    static void bfrt_eight_union(const bfrt_eight *e, float *side)
    {
        for (int k = 0; k < 3; k++) {
            float lo = INFINITY, hi = -INFINITY;
            for (int i = 0; i < BFRT_BOXES; i++) {
                lo = e->side[k][i] < lo ? e->side[k][i] : lo;
                hi = e->side[3 + k][i] > hi ? e->side[3 + k][i] : hi;
            }
            side[k] = lo;
            side[3 + k] = hi;
        }
    }

    /* What bfrt_below says of the numbers of all sides. */
    BFRT_CLONES
    static void bfrt_eight_below(const double *x, float *below)
    {
        int32_t bits[BFRT_SIDES], off[BFRT_SIDES];
        for (int j = 0; j < BFRT_SIDES; j++) {
            float f = below[j] = (float)x[j];
            off[j] = f == 0.0f ? (x[j] < 0.0 ? INT32_MIN : 0) : (double)f > x[j];
        }
        memcpy(bits, below, sizeof bits);
        for (int j = 0; j < BFRT_SIDES; j++) {
            int32_t away = 2 * (bits[j] < 0) - 1; /* to the number below: in bits, off from zero */
            bits[j] = off[j] == INT32_MIN ? INT32_MIN + 1 : bits[j] + off[j] * away;
        }
        memcpy(below, bits, sizeof bits);
    }

    /* Eight boxes as rays meet them. */
    typedef struct {
        double side[6][BFRT_BOXES];
    } bfrt_padded_eight;

    BFRT_CLONES
    static void bfrt_eight_pad(const bfrt_eight *e, double padding, bfrt_padded_eight *g)
    {
        for (int k = 0; k < 3; k++)
            for (int i = 0; i < BFRT_BOXES; i++) {
                g->side[k][i] = e->side[k][i] - padding;
                g->side[3 + k][i] = e->side[3 + k][i] + padding;
            }
    }

    /* Where a line, from t = 0 on, is inside each of eight boxes that are not empty: near > far
       for nowhere. Returns, as bits, those that it comes into no later than at `reach`. */
    BFRT_CLONES
    static unsigned bfrt_eight_span(const bfrt_padded_eight *g, const double *o, const double *d,
                                    double reach, double *inv, double *near, double *far)
    {
        uint8_t met[BFRT_BOXES];
        uint64_t all;
        for (int i = 0; i < BFRT_BOXES; i++) {
            near[i] = 0.0;
            far[i] = INFINITY;
        }
        for (int k = 0; k < 3; k++) {
            const double *lo = g->side[k], *hi = g->side[3 + k];
            double raw = 1.0 / d[k], from = o[k];
            double step = inv[k] = fabs(raw) <= DBL_MAX ? raw : 0.0;
            for (int i = 0; i < BFRT_BOXES; i++) {
                double p = (lo[i] - from) * step;
                double q = (hi[i] - from) * step;
                double in = p < q ? p : q;
                double out = p > q ? p : q;
                double never = (lo[i] <= from && from <= hi[i]) ? -INFINITY : INFINITY;
                in = step == 0.0 ? never : in;
                out = step == 0.0 ? -never : out;
                near[i] = in > near[i] ? in : near[i];
                far[i] = out < far[i] ? out : far[i];
            }
        }
        for (int i = 0; i < BFRT_BOXES; i++)
            met[i] = (near[i] <= far[i]) & (near[i] <= reach);
        memcpy(&all, met, sizeof all);
        return (unsigned)(all * 0x0102040810204080u >> 56); /* a byte's lowest bit each */
    }
    """
    enum:
        BOXES "BFRT_BOXES"
        SIDES "BFRT_SIDES"

    ctypedef struct BoxPacket "bfrt_eight":
        float side[6][8]

    bint eight_empty "bfrt_eight_empty"(const BoxPacket* e, int i) noexcept nogil
    void eight_of "bfrt_eight_of"(const float* side, int n, BoxPacket* e) noexcept nogil
    void eight_end "bfrt_eight_end"(BoxPacket* e, int n) noexcept nogil
    void eight_union "bfrt_eight_union"(const BoxPacket* e, float* side) noexcept nogil
    void eight_below "bfrt_eight_below"(const double* x, float* below) noexcept nogil

    ctypedef struct PaddedPacket "bfrt_padded_eight":
        double side[6][8]

    void eight_pad "bfrt_eight_pad"(
        const BoxPacket* e, double padding, PaddedPacket* g
    ) noexcept nogil
    unsigned int eight_span "bfrt_eight_span"(
        const PaddedPacket* g, const double* o, const double* d, double reach, double* inv,
        double* near, double* far
    ) noexcept nogil


cdef inline void eight_clear(BoxPacket* e, int i) noexcept nogil:
    """Make one of them empty."""
    cdef int k
    for k in range(3):
        e.side[k][i], e.side[HIGH + k][i] = INFINITY, -INFINITY


cdef inline void padded_at(const PaddedPacket* g, int i, PaddedBox* one) noexcept nogil:
    """Return box i of the eight padded boxes."""
    cdef int k
    for k in range(3):
        one.lo[k] = g.side[k][i]
        one.hi[k] = g.side[HIGH + k][i]
