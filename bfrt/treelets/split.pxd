"""Splits of boxes by the surface area heuristic: the work of a tree's build.

A range of references, each a box and whose it is, is divided in two in place. After Wald, "On fast
Construction of SAH-based Bounding Volume Hierarchies" (2007): the centers of the boxes fall into
equal bins on each axis, up to BINS and fewer for few boxes, as there, and the best of all borders
between bins is taken. Where all centers are in one place the range is halved.
"""

from libc.stdint cimport int64_t, uint32_t

from bfrt.geometry.box cimport Box

cdef extern from *:
    """
    #include <math.h>
    #include <stdint.h>
    #include <string.h>

    enum { BFRT_BINS = 16, BFRT_LEAST_BINS = 4, BFRT_EACH_BIN = 4 };

    typedef float bfrt_four __attribute__((vector_size(16)));
    typedef int32_t bfrt_four_int __attribute__((vector_size(16)));

    /* A box and whose it is: both corners are vectors of four, whose last is no coordinate. */
    typedef union {
        struct { bfrt_four lo, hi; } side;
        struct { float lo[3]; uint32_t of; float hi[3]; uint32_t unused; } box;
    } bfrt_reference;

    typedef struct {
        bfrt_four lo, hi;
    } bfrt_range_box;

    static inline bfrt_four bfrt_least(bfrt_four a, bfrt_four b)
    {
    #ifdef __SSE__
        return __builtin_ia32_minps(a, b);
    #else
        bfrt_four_int less = a < b;
        return (bfrt_four)((less & (bfrt_four_int)a) | (~less & (bfrt_four_int)b));
    #endif
    }

    static inline bfrt_four bfrt_most(bfrt_four a, bfrt_four b)
    {
    #ifdef __SSE__
        return __builtin_ia32_maxps(a, b);
    #else
        return -bfrt_least(-a, -b);
    #endif
    }

    static inline bfrt_range_box bfrt_no_box(void)
    {
        const float inf = INFINITY;
        bfrt_range_box none = {{inf, inf, inf, inf}, {-inf, -inf, -inf, -inf}};
        return none;
    }

    static inline void bfrt_enclose(bfrt_range_box *all, bfrt_four lo, bfrt_four hi)
    {
        all->lo = bfrt_least(all->lo, lo);
        all->hi = bfrt_most(all->hi, hi);
    }

    static inline float bfrt_half_surface(const bfrt_range_box *b)
    {
        /* Sides beyond count as this: products of infinite ones may be no numbers. */
        const bfrt_four most = {1e18f, 1e18f, 1e18f, 1e18f};
        bfrt_four d = bfrt_least(b->hi - b->lo, most);
        return d[0] * d[1] + d[1] * d[2] + d[2] * d[0];
    }

    /* A difference may be infinite, which without a scale is no number: `top` then. */
    static inline bfrt_four_int bfrt_bins_of(const bfrt_reference *r, bfrt_four low,
                                             bfrt_four scale, bfrt_four top)
    {
        const bfrt_four zero = {0.0f, 0.0f, 0.0f, 0.0f};
        bfrt_four at = (r->side.lo * 0.5f + r->side.hi * 0.5f - low) * scale;
        return __builtin_convertvector(bfrt_most(bfrt_least(at, top), zero), bfrt_four_int);
    }

    /* The box around references, the last component of which means nothing. */
    static inline void bfrt_range_bounds(const bfrt_reference *r, int64_t n, bfrt_range_box *all)
    {
        *all = bfrt_no_box();
        for (int64_t i = 0; i < n; i++)
            bfrt_enclose(all, r[i].side.lo, r[i].side.hi);
    }

    /* Divide n references, two or more, in place; return how many are in the first part, from 1 to
       n - 1. The boxes around both come back. They may be `halved` as they lie, too. */
    static int64_t bfrt_split(bfrt_reference *r, int64_t n, int halved, bfrt_range_box *first,
                              bfrt_range_box *second)
    {
        bfrt_range_box centers = bfrt_no_box();
        for (int64_t i = 0; i < n; i++) {
            bfrt_four center = r[i].side.lo * 0.5f + r[i].side.hi * 0.5f;
            bfrt_enclose(&centers, center, center);
        }
        /* Most ranges are small, and their bins would take longer than their boxes. */
        int64_t few = BFRT_LEAST_BINS + n / BFRT_EACH_BIN;
        int last = (int)(few < BFRT_BINS ? few : BFRT_BINS);
        bfrt_four scale, low = centers.lo;
        bfrt_range_box best_first, best_second; /* the boxes around the bins on either side */
        int best_axis = -1, best_bin = 0;
        int64_t middle = n / 2;
        for (int k = 0; k < 4; k++) {
            float wide = k < 3 ? centers.hi[k] - low[k] : 0.0f;
            scale[k] = wide > 0.0f && isfinite(wide) ? last * (1.0f - 0x1p-20f) / wide : 0.0f;
            if (!isfinite(scale[k]))
                scale[k] = 0.0f;
        }
        low[3] = 0.0f;
        const float end = (float)(last - 1);
        const bfrt_four top = {end, end, end, end};
        if (!halved && n > 2 && (scale[0] > 0.0f || scale[1] > 0.0f || scale[2] > 0.0f)) {
            bfrt_range_box bins[3][BFRT_BINS];
            int64_t counts[3][BFRT_BINS] = {{0}};
            float best = INFINITY;
            for (int k = 0; k < 3; k++)
                for (int b = 0; b < last; b++)
                    bins[k][b] = bfrt_no_box();
            for (int64_t i = 0; i < n; i++) {
                bfrt_four_int at = bfrt_bins_of(&r[i], low, scale, top);
                for (int k = 0; k < 3; k++) {
                    bfrt_enclose(&bins[k][at[k]], r[i].side.lo, r[i].side.hi);
                    counts[k][at[k]]++;
                }
            }
            for (int k = 0; k < 3; k++) {
                float costs[BFRT_BINS];
                bfrt_range_box below[BFRT_BINS], all = bfrt_no_box();
                int64_t sum = 0;
                if (!(scale[k] > 0.0f))
                    continue;
                for (int b = 0; b < last - 1; b++) {
                    bfrt_enclose(&all, bins[k][b].lo, bins[k][b].hi);
                    sum += counts[k][b];
                    below[b] = all;
                    costs[b] = sum ? sum * bfrt_half_surface(&all) : 0.0f;
                }
                all = bfrt_no_box();
                sum = 0;
                for (int b = last - 1; b > 0; b--) {
                    bfrt_enclose(&all, bins[k][b].lo, bins[k][b].hi);
                    sum += counts[k][b];
                    float cost = costs[b - 1] + (sum ? sum * bfrt_half_surface(&all) : 0.0f);
                    if (sum > 0 && sum < n && cost < best) {
                        best = cost;
                        best_axis = k;
                        best_bin = b;
                        best_first = below[b - 1];
                        best_second = all;
                    }
                }
            }
        }
        if (best_axis >= 0) {
            int64_t i = 0, j = n - 1;
            *first = best_first;
            *second = best_second;
            for (;;) {
                while (i <= j && bfrt_bins_of(&r[i], low, scale, top)[best_axis] < best_bin)
                    i++;
                while (i <= j && bfrt_bins_of(&r[j], low, scale, top)[best_axis] >= best_bin)
                    j--;
                if (i > j)
                    break;
                bfrt_reference t = r[i];
                r[i++] = r[j];
                r[j--] = t;
            }
            return i;
        }
        bfrt_range_bounds(r, middle, first);
        bfrt_range_bounds(r + middle, n - middle, second);
        return middle;
    }
    """
    ctypedef struct Reference "bfrt_reference":
        pass

    ctypedef struct RangeBox "bfrt_range_box":
        pass

    int64_t split_range "bfrt_split"(
        Reference* r, int64_t n, bint halved, RangeBox* first, RangeBox* second
    ) noexcept nogil
    void range_bounds "bfrt_range_bounds"(
        const Reference* r, int64_t n, RangeBox* all
    ) noexcept nogil
    float half_surface "bfrt_half_surface"(const RangeBox* b) noexcept nogil

cdef extern from *:
    """
    enum { BFRT_NUMBER = 1 << 30 }; /* the bits of 2.0f */

    static inline void bfrt_refer(bfrt_reference *r, const float *lo, const float *hi, uint32_t of)
    {
        memcpy(r->box.lo, lo, 12);
        memcpy(r->box.hi, hi, 12);
        r->box.of = of | BFRT_NUMBER; /* as a float it is no denormal, which would take long */
        r->box.unused = BFRT_NUMBER;
    }

    static inline uint32_t bfrt_referred(const bfrt_reference *r)
    {
        return r->box.of & (BFRT_NUMBER - 1);
    }

    static inline void bfrt_box_of(const bfrt_range_box *b, float *lo, float *hi)
    {
        memcpy(lo, &b->lo, 12);
        memcpy(hi, &b->hi, 12);
    }
    """
    void refer "bfrt_refer"(
        Reference* r, const float* lo, const float* hi, uint32_t of
    ) noexcept nogil
    uint32_t referred "bfrt_referred"(const Reference* r) noexcept nogil
    void box_of "bfrt_box_of"(const RangeBox* b, float* lo, float* hi) noexcept nogil


cdef inline Box range_box(const RangeBox* b) noexcept nogil:
    """Return the box around a range."""
    cdef Box box
    box_of(b, box.lo, box.hi)
    return box
