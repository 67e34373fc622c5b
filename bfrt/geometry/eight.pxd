"""Eight boxes side by side, in vector lanes: their voxels, the regions that a voxel's rays enter,
and the boxes that one line meets. What is said of one box at a time, box.pxd and grid.pxd say.

::

    side    [LOW + axis], [HIGH + axis], of each of the eight
    empty   lo > hi on some axis; so are those beyond the last, where there are fewer

The other way round, one box against many lines, is lanes.pxd's, whose BFRT_CLONES and whose
promise of the same bits hold here too.
"""

from libc.math cimport INFINITY
from libc.stdint cimport uint8_t

from bfrt.geometry.box cimport Grown
from bfrt.geometry.grid cimport HIGH, Grid, Range, located
from bfrt.geometry.lanes cimport LANES  # and BFRT_CLONES

cdef extern from *:
    """
    #include <limits.h>
    #include <stdint.h>
    #include <string.h>

    enum { BFRT_BOXES = 8, BFRT_SIDES = 6 * BFRT_BOXES, BFRT_START = 6 };

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

    /* Of a grid, for each side of the eight boxes. */
    typedef struct {
        double grow[BFRT_SIDES];     /* twice d, outwards */
        double first[BFRT_SIDES];    /* the first plane */
        double inverse[BFRT_SIDES];
        double slack[BFRT_SIDES];
        double last[BFRT_SIDES];     /* the last voxel */
    } bfrt_sides;

    typedef struct {
        int side[6][BFRT_BOXES];
    } bfrt_voxels;

    /* The voxel of each side; whether arithmetic may differ from the table for one. All sides are
       one loop, for gcc leaves nested ones as they are. */
    BFRT_CLONES
    static int bfrt_eight_voxels(const bfrt_sides *s, const bfrt_eight *e, bfrt_voxels *v)
    {
        const float *side = &e->side[0][0];
        int *voxel = &v->side[0][0];
        int differ = 0, empty = 0;
        for (int j = 0; j < BFRT_SIDES; j++) {
            double guess = ((side[j] + s->grow[j]) - s->first[j]) * s->inverse[j];
            double low = guess - s->slack[j], high = guess + s->slack[j];
            low = low > 0.0 ? low : 0.0;
            low = low < s->last[j] ? low : s->last[j];
            high = high > 0.0 ? high : 0.0;
            high = high < s->last[j] ? high : s->last[j];
            voxel[j] = (int)low;
            differ |= (int)low ^ (int)high;
        }
        for (int j = 0; j < BFRT_SIDES / 2; j++)
            empty |= side[j] > side[BFRT_SIDES / 2 + j];
        for (int i = 0; empty && i < BFRT_BOXES; i++)
            if (bfrt_eight_empty(e, i))
                for (int k = 0; k < 3; k++) {
                    v->side[k][i] = INT_MAX;
                    v->side[3 + k][i] = -1;
                }
        return differ;
    }

    typedef int bfrt_ints __attribute__((vector_size(4 * BFRT_BOXES)));

    /* Which of the eight regions a ray enters that comes into each of n voxels by a face, as bits:
       its voxel is in them, and on that side of them. */
    BFRT_CLONES
    static void bfrt_entered(const bfrt_voxels *v, int n, const int (*at)[3], const uint8_t *face,
                             uint8_t *which)
    {
        const bfrt_ints bits = {1, 2, 4, 8, 16, 32, 64, 128};
        bfrt_ints side[6];
        memcpy(side, v, sizeof side);
        for (int j = 0; j < n; j++) {
            int x = at[j][0], y = at[j][1], z = at[j][2], f = face[j];
            bfrt_ints in = (side[0] <= x) & (side[3] >= x) & (side[1] <= y) & (side[4] >= y)
                & (side[2] <= z) & (side[5] >= z);
            if (f != BFRT_START)
                in &= side[f] == at[j][f % 3];
            in &= bits;
            uint64_t pairs[BFRT_BOXES / 2];
            memcpy(pairs, &in, sizeof pairs);
            uint64_t both = (pairs[0] | pairs[1]) | (pairs[2] | pairs[3]);
            which[j] = (uint8_t)(both | both >> 32);
        }
    }

    /* Eight boxes as rays meet them. */
    typedef struct {
        double side[6][BFRT_BOXES];
    } bfrt_grown_eight;

    BFRT_CLONES
    static void bfrt_eight_grow(const bfrt_eight *e, double grow, bfrt_grown_eight *g)
    {
        for (int k = 0; k < 3; k++)
            for (int i = 0; i < BFRT_BOXES; i++) {
                g->side[k][i] = e->side[k][i] - grow;
                g->side[3 + k][i] = e->side[3 + k][i] + grow;
            }
    }

    /* Where a line, from t = 0 on, is inside each of eight boxes that are not empty: near > far
       for nowhere. Returns, as bits, those that it comes into no later than at `reach`. */
    BFRT_CLONES
    static unsigned bfrt_eight_span(const bfrt_grown_eight *g, const double *o, const double *d,
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

    ctypedef struct Eight "bfrt_eight":
        float side[6][8]

    bint eight_empty "bfrt_eight_empty"(const Eight* e, int i) noexcept nogil
    void eight_of "bfrt_eight_of"(const float* side, int n, Eight* e) noexcept nogil
    void eight_end "bfrt_eight_end"(Eight* e, int n) noexcept nogil
    void eight_union "bfrt_eight_union"(const Eight* e, float* side) noexcept nogil
    void eight_below "bfrt_eight_below"(const double* x, float* below) noexcept nogil

    ctypedef struct Sides "bfrt_sides":
        double grow[48]
        double first[48]
        double inverse[48]
        double slack[48]
        double last[48]

    ctypedef struct Voxels "bfrt_voxels":
        int side[6][8]

    bint voxels_unsure "bfrt_eight_voxels"(const Sides* s, const Eight* e,
                                           Voxels* v) noexcept nogil
    void entered "bfrt_entered"(const Voxels* v, int n, const int (*at)[3], const uint8_t* face,
                                uint8_t* which) noexcept nogil

    ctypedef struct GrownEight "bfrt_grown_eight":
        double side[6][8]

    void eight_grow "bfrt_eight_grow"(const Eight* e, double grow, GrownEight* g) noexcept nogil
    unsigned int eight_span "bfrt_eight_span"(const GrownEight* g, const double* o, const double* d,
                                              double reach, double* inv, double* near,
                                              double* far) noexcept nogil


cdef inline void eight_clear(Eight* e, int i) noexcept nogil:
    """Make one of them empty."""
    cdef int k
    for k in range(3):
        e.side[k][i], e.side[HIGH + k][i] = INFINITY, -INFINITY


cdef inline void grown_at(const GrownEight* g, int i, Grown* one) noexcept nogil:
    """One of them."""
    cdef int k
    for k in range(3):
        one.lo[k] = g.side[k][i]
        one.hi[k] = g.side[HIGH + k][i]


cdef inline void sides_of(const Grid* g, Sides* s) noexcept nogil:
    """What `eight_voxels` has to know of a grid."""
    cdef int j, k
    for j in range(SIDES):
        k = j // BOXES % 3
        s.grow[j] = (2.0 if j >= SIDES // 2 else -2.0) * g.grow
        s.first[j] = g.plane[k][0]
        s.inverse[j] = g.inverse[k]
        s.slack[j] = g.slack[k]
        s.last[j] = g.n[k] - 1


cdef inline void eight_voxels(const Grid* g, const Sides* s, const Eight* e,
                              Voxels* v) noexcept nogil:
    """The voxels of each, as `box_range` says; of an empty one a range that nothing is in."""
    cdef int i, k
    if voxels_unsure(s, e, v):
        for i in range(BOXES):
            if not eight_empty(e, i):
                for k in range(6):
                    v.side[k][i] = located(g, k % 3, e.side[k][i] + s.grow[BOXES * k])


cdef inline Range range_at(const Voxels* v, int i) noexcept nogil:
    """The voxels of one of them."""
    cdef Range r
    cdef int k
    for k in range(3):
        r.lo[k] = v.side[k][i]
        r.hi[k] = v.side[HIGH + k][i]
    return r
