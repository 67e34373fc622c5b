"""Loops in vector lanes: one box against many lines, what box.pxd's `grown_span` says of each; the
voxels of some boxes, what grid.pxd's `box_range` says; and some boxes coded, as quantised.pxd says.

The loop is C, for Cython has no way to ask for it in several instruction sets. The best that the
processor has is picked when the module is loaded; all give the same bits, since each is the same
IEEE operations in the same order, and never a fused one.
"""

from bfrt.geometry.box cimport Box, Grown, box_empty
from bfrt.geometry.grid cimport Grid, Range, box_range

cdef extern from *:
    """
    #include <float.h>
    #include <math.h>
    #include <stdint.h>
    #include <string.h>

    #if defined(__x86_64__) && defined(__GLIBC__) && defined(__has_attribute)
    #if __has_attribute(target_clones) && !defined(__SANITIZE_ADDRESS__)
    #define BFRT_CLONES __attribute__((target_clones("avx512f", "avx2", "default")))
    #endif
    #endif
    #ifndef BFRT_CLONES
    #define BFRT_CLONES
    #endif

    enum { BFRT_LANES = 64 };

    typedef struct {
        double o[3][BFRT_LANES];
        double d[3][BFRT_LANES];
        double inv[3][BFRT_LANES];
        double near[BFRT_LANES];
        double far[BFRT_LANES];
    } bfrt_lanes;

    /* Where each of the first n lines, from t = 0 on, is inside the box: near > far for nowhere. */
    BFRT_CLONES
    static void bfrt_lanes_span(bfrt_lanes *l, int n, const double *lo, const double *hi)
    {
        for (int i = 0; i < n; i++) {
            l->near[i] = 0.0;
            l->far[i] = INFINITY;
        }
        for (int k = 0; k < 3; k++) {
            const double *o = l->o[k], *d = l->d[k];
            for (int i = 0; i < n; i++) {
                double raw = 1.0 / d[i];
                double inv = fabs(raw) <= DBL_MAX ? raw : 0.0;
                double a = (lo[k] - o[i]) * inv;
                double b = (hi[k] - o[i]) * inv;
                double in = a < b ? a : b;
                double out = a > b ? a : b;
                double never = (lo[k] <= o[i] && o[i] <= hi[k]) ? -INFINITY : INFINITY;
                in = inv == 0.0 ? never : in;
                out = inv == 0.0 ? -never : out;
                l->inv[k][i] = inv;
                l->near[i] = in > l->near[i] ? in : l->near[i];
                l->far[i] = out < l->far[i] ? out : l->far[i];
            }
        }
    }

    enum { BFRT_BOXES = 8, BFRT_SIDES = 48 };

    /* Of a grid, for each of the six sides of eight boxes. */
    typedef struct {
        double grow[BFRT_SIDES];     /* twice d, outwards */
        double first[BFRT_SIDES];    /* the first plane */
        double inverse[BFRT_SIDES];
        double slack[BFRT_SIDES];
        double last[BFRT_SIDES];     /* the last voxel */
    } bfrt_sides;

    /* The voxel of each side of the first n boxes; whether arithmetic may differ from the table. */
    BFRT_CLONES
    static int bfrt_sides_voxels(const bfrt_sides *s, const float *side, int n, int *voxel)
    {
        int differ = 0;
        for (int j = 0; j < 6 * n; j++) {
            double guess = ((side[j] + s->grow[j]) - s->first[j]) * s->inverse[j];
            double low = guess - s->slack[j], high = guess + s->slack[j];
            low = low > 0.0 ? low : 0.0;
            low = low < s->last[j] ? low : s->last[j];
            high = high > 0.0 ? high : 0.0;
            high = high < s->last[j] ? high : s->last[j];
            voxel[j] = (int)low;
            differ |= (int)low ^ (int)high;
        }
        return differ;
    }

    /* What bfrt_below says of each of the first n numbers. */
    BFRT_CLONES
    static void bfrt_all_below(const double *x, int n, float *below)
    {
        int32_t bits[BFRT_SIDES], off[BFRT_SIDES];
        for (int j = 0; j < n; j++) {
            float f = below[j] = (float)x[j];
            off[j] = f == 0.0f ? (x[j] < 0.0 ? INT32_MIN : 0) : (double)f > x[j];
        }
        memcpy(bits, below, n * sizeof(float));
        for (int j = 0; j < n; j++) {
            int32_t away = 2 * (bits[j] < 0) - 1; /* to the number below: in bits, off from zero */
            bits[j] = off[j] == INT32_MIN ? INT32_MIN + 1 : bits[j] + off[j] * away;
        }
        memcpy(below, bits, n * sizeof(float));
    }

    /* The sides that hold the boxes, and a step inwards, for each of eight boxes. */
    typedef struct {
        float from[BFRT_SIDES];
        float step[BFRT_SIDES];
    } bfrt_coding;

    /* The voxel of each side of the first n coded boxes, moved further in than what was coded can
       be: by two steps, and one for the rounding of sums. */
    BFRT_CLONES
    static void bfrt_sides_inside(const bfrt_sides *s, const bfrt_coding *c, const float *side,
                                  int n, int *voxel)
    {
        for (int j = 0; j < 6 * n; j++) {
            double inside = side[j] + 3.0 * c->step[j];
            double slack = s->grow[j] < 0.0 ? s->slack[j] : -s->slack[j];
            double guess = ((inside + s->grow[j]) - s->first[j]) * s->inverse[j] + slack;
            guess = guess > 0.0 ? guess : 0.0;
            voxel[j] = (int)(guess < s->last[j] ? guess : s->last[j]);
        }
    }

    /* The sides of the first n boxes. */
    BFRT_CLONES
    static void bfrt_decode(const bfrt_coding *c, const uint8_t *code, int n, float *side)
    {
        for (int j = 0; j < 6 * n; j++)
            side[j] = c->from[j] + (float)code[j] * c->step[j];
    }

    /* The codes of the first n boxes; whether one is inside, for steps are all but rounded away. */
    BFRT_CLONES
    static int bfrt_encode(const bfrt_coding *c, const float *side, int n, uint8_t *code)
    {
        int whole[BFRT_SIDES], off = 0;
        for (int j = 0; j < 6 * n; j++) {
            float from = c->from[j], step = c->step[j], x = side[j];
            float in = copysignf(1.0f, step);
            float guess = (x - from) / step;
            guess = guess > 0.0f ? guess : 0.0f;
            int k = (int)(guess < 255.0f ? guess : 255.0f);
            k -= (from + (float)k * step - x) * in > 0.0f;
            k = k < 0 ? 0 : k;
            off |= (from + (float)k * step - x) * in > 0.0f;
            whole[j] = k;
        }
        for (int j = 0; j < 6 * n; j++)
            code[j] = (uint8_t)whole[j];
        return off;
    }
    """
    enum:
        BOXES "BFRT_BOXES"

    ctypedef struct Sides "bfrt_sides":
        double grow[48]
        double first[48]
        double inverse[48]
        double slack[48]
        double last[48]

    int sides_voxels "bfrt_sides_voxels"(const Sides* s, const float* side, int n,
                                         int* voxel) noexcept nogil

    void all_below "bfrt_all_below"(const double* x, int n, float* below) noexcept nogil

    ctypedef struct Coding "bfrt_coding":
        float from_ "from"[48]
        float step[48]

    void sides_inside "bfrt_sides_inside"(const Sides* s, const Coding* c, const float* side, int n,
                                          int* voxel) noexcept nogil
    void decode "bfrt_decode"(const Coding* c, const unsigned char* code, int n,
                              float* side) noexcept nogil
    bint encode "bfrt_encode"(const Coding* c, const float* side, int n,
                              unsigned char* code) noexcept nogil

    enum:
        LANES "BFRT_LANES"

    ctypedef struct Lanes "bfrt_lanes":
        double o[3][64]
        double d[3][64]
        double inv[3][64]
        double near[64]
        double far[64]

    void lanes_span "bfrt_lanes_span"(Lanes* l, int n, const double* lo,
                                      const double* hi) noexcept nogil


cdef inline void grown_lanes(Lanes* l, int n, const Grown* g) noexcept nogil:
    """Set near and far of the first n lines, from their o and d."""
    lanes_span(l, n, &g.lo[0], &g.hi[0])


cdef inline void sides_of(const Grid* g, Sides* s) noexcept nogil:
    """What `box_ranges` has to know of a grid."""
    cdef int j, k
    for j in range(6 * BOXES):
        k = j % 3
        s.grow[j] = (2.0 if j % 6 >= 3 else -2.0) * g.grow
        s.first[j] = g.plane[k][0]
        s.inverse[j] = g.inverse[k]
        s.slack[j] = g.slack[k]
        s.last[j] = g.n[k] - 1


cdef inline void box_ranges(const Grid* g, const Sides* s, const Box* boxes, int n,
                            Range* ranges) noexcept nogil:
    """The voxels of the first n boxes, BOXES or fewer; of empty ones anything."""
    cdef int i
    if sides_voxels(s, &boxes[0].lo[0], n, &ranges[0].lo[0]):
        for i in range(n):
            if not box_empty(&boxes[i]):
                box_range(g, &boxes[i], &ranges[i])


cdef inline void least_ranges(const Sides* s, const Coding* c, const Box* boxes, int n,
                              Range* ranges) noexcept nogil:
    """The voxels that the first n boxes, which are quantised, have at the least: by arithmetic,
    never one more. A range ends before it begins where there need be none."""
    sides_inside(s, c, &boxes[0].lo[0], n, &ranges[0].lo[0])


cdef inline void range_union(const Range* ranges, const Box* boxes, int n,
                             Range* all) noexcept nogil:
    """The voxels that any of the boxes reaches; a range that ends before it begins if none does."""
    cdef int i, k
    for k in range(3):
        all.lo[k] = 0x7FFFFFFF
        all.hi[k] = -1
    for i in range(n):
        if box_empty(&boxes[i]):
            continue
        for k in range(3):
            all.lo[k] = min(all.lo[k], ranges[i].lo[k])
            all.hi[k] = max(all.hi[k], ranges[i].hi[k])
