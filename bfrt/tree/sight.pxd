"""Rays as the nodes of a treelet see them: in a frame near it, where float32 is exact enough.

A sight begins near the base, which is the low corner of a box around the nodes, and its t counts in
units of the direction's largest part. A side at s, of an axis with slope m, is passed at (s - o) m:
off by no more than 2^-22 (|s| + |o|) |m|, for s, o and m are rounded to float32, as are the product
and the sum. That, the growth of boxes, and what o lost in float64, is its slack. An axis along
which the ray goes less than 2^-40 of its way, or none, is given the slope 2^40: its sides are
passed long before and long after all others, or, where the ray is outside, neither.

Nodes only cull: where a ray is said to enter a box no later, and to leave it no earlier, than it
does the objects' own boxes, grown, no hit is lost. What vector width computes that, and how it
rounds, changes no answer.
"""

from libc.stdint cimport int32_t

from bfrt.geometry.box cimport Box
from bfrt.geometry.vector cimport Line
from bfrt.treelets.node cimport Node

cdef extern from *:
    """
    #include <math.h>
    #include <stdint.h>
    #include <string.h>

    #define BFRT_STILL 0x1p-40

    static inline double bfrt_most(double a, double b) { return a > b ? a : b; }

    /* A line, by what all of its sights share. */
    typedef struct {
        double o[3];
        double d[3];
        double inv[3]; /* 1 / |d|; 0 where the ray is still */
        double slope[3];
        double grow; /* by which boxes are */
        double unit; /* the largest part of d: a sight's t for 1 of the line's */
        double per; /* 1 / unit */
    } bfrt_heading;

    /* A ray as nodes in a box see it. The fourth of four is no axis. */
    typedef struct {
        float base[4];
        float slope[4];
        float early[4]; /* of sides by which the ray enters, and leaves: t = side * slope + this */
        float late[4];
        int32_t in[3]; /* of an axis, where in a node those sides are */
        int32_t out[3];
        double start; /* the line's t at which the sight's is 0 */
        double unit;
    } bfrt_sight;

    static inline void bfrt_heading_of(const double *o, const double *d, double grow,
                                       bfrt_heading *h)
    {
        h->grow = grow;
        h->unit = bfrt_most(fabs(d[0]), bfrt_most(fabs(d[1]), fabs(d[2])));
        h->per = 1.0 / h->unit;
        for (int k = 0; k < 3; k++) {
            int still = fabs(d[k]) <= BFRT_STILL * h->unit;
            double inv = still ? 0.0 : 1.0 / d[k];
            h->o[k] = o[k];
            h->d[k] = d[k];
            h->inv[k] = fabs(inv);
            h->slope[k] = still ? 1.0 / BFRT_STILL : inv * h->unit;
        }
    }

    static inline void bfrt_sight_along(const bfrt_heading *h, const float *base, const float *end,
                                        bfrt_sight *s)
    {
        double extent = 0.0, start = 0.0;
        for (int k = 0; k < 3; k++) {
            extent = bfrt_most(extent, (double)end[k] - base[k]);
            double way = h->d[k] > 0.0 ? base[k] - h->o[k] : h->o[k] - end[k];
            start = bfrt_most(start, (way - 1.01 * h->grow) * h->inv[k]);
        }
        /* A little before the box: the ray begins near it, wherever it comes from. */
        start = bfrt_most(0.0, start - extent * h->per - 0x1p-40 * start);
        s->base[3] = s->slope[3] = s->early[3] = s->late[3] = 0.0f;
        s->start = start;
        s->unit = h->unit;
        for (int k = 0; k < 3; k++) {
            double from = h->o[k] + start * h->d[k], near = from - base[k], slope = h->slope[k];
            double slack = 1.001 * h->grow + 0x1p-21 * (fabs(near) + extent) + 0x1p-126
                + 0x1p-49 * (fabs(h->o[k]) + fabs(from) + fabs(base[k]));
            if (h->inv[k] == 0.0) /* what the ray goes there on its way through the box */
                slack += BFRT_STILL * (4.0 * extent + 0x1p-38 * start * h->unit);
            slack *= fabs(slope);
            if ((fabs(near) + 2.0 * extent) * fabs(slope) + slack > 0x1p126) {
                slope = near = 0.0; /* beyond float32: no side of this axis is asked */
                slack = INFINITY;
            }
            s->slope[k] = (float)slope;
            s->early[k] = (float)(-near * slope - slack);
            s->late[k] = (float)(-near * slope + slack);
            s->in[k] = (slope > 0.0 ? 0 : 3 * BFRT_WIDE) + k * BFRT_WIDE;
            s->out[k] = (slope > 0.0 ? 3 * BFRT_WIDE : 0) + k * BFRT_WIDE;
            s->base[k] = base[k];
        }
    }

    /* The line's t in the sight's, rounded up. */
    static inline float bfrt_sight_reach(const bfrt_sight *s, double t)
    {
        double reach = (t - s->start) * s->unit;
        return (float)(reach + 0x1p-22 * fabs(reach) + 0x1p-126);
    }

    static unsigned bfrt_spans_plain(const bfrt_node *node, const bfrt_sight *s, float reach,
                                     float *near)
    {
        float far[BFRT_WIDE];
        unsigned met = 0;
        for (int i = 0; i < BFRT_WIDE; i++) {
            near[i] = 0.0f;
            far[i] = reach;
        }
        for (int k = 0; k < 3; k++) {
            float low = node->low[k] - s->base[k];
            float pace = (float)(bfrt_quantum(node->exponent[k]) * s->slope[k]);
            float early = low * s->slope[k] + s->early[k], late = low * s->slope[k] + s->late[k];
            const uint8_t *in = node->lo[0] + s->in[k], *out = node->lo[0] + s->out[k];
            for (int i = 0; i < BFRT_WIDE; i++) {
                float a = in[i] * pace + early, b = out[i] * pace + late;
                near[i] = a > near[i] ? a : near[i]; /* of a NaN nothing is taken */
                far[i] = b < far[i] ? b : far[i];
            }
        }
        for (int i = 0; i < BFRT_WIDE; i++)
            met |= (unsigned)(near[i] <= far[i] && node->count[i]) << i;
        return met;
    }

    #if defined(__x86_64__) && defined(__GNUC__)
    #include <immintrin.h>

    __attribute__((target("avx2,fma")))
    static unsigned bfrt_spans_avx2(const bfrt_node *node, const bfrt_sight *s, float reach,
                                    float *entry)
    {
        int32_t exponents;
        memcpy(&exponents, node->exponent, sizeof exponents); /* and inner, the fourth */
        __m128 slope = _mm_loadu_ps(s->slope);
        __m128 low = _mm_insert_ps(_mm_loadu_ps(node->low), _mm_setzero_ps(), 0x38);
        low = _mm_sub_ps(low, _mm_loadu_ps(s->base));
        __m128i quantum = _mm_cvtepi8_epi32(_mm_cvtsi32_si128(exponents));
        quantum = _mm_slli_epi32(_mm_add_epi32(quantum, _mm_set1_epi32(127)), 23);
        __m128 paces = _mm_mul_ps(_mm_castsi128_ps(quantum), slope);
        __m128 early = _mm_fmadd_ps(low, slope, _mm_loadu_ps(s->early));
        __m128 late = _mm_fmadd_ps(low, slope, _mm_loadu_ps(s->late));
        __m256 from = _mm256_setzero_ps(), to = _mm256_set1_ps(reach);
    #define BFRT_SIDES(offset) _mm256_cvtepi32_ps(_mm256_cvtepu8_epi32( \\
        _mm_loadl_epi64((const __m128i *)(node->lo[0] + (offset)))))
    #define BFRT_AXIS(k) do { \\
        __m256 pace = _mm256_broadcastss_ps(_mm_permute_ps(paces, k)); \\
        __m256 a = _mm256_fmadd_ps(BFRT_SIDES(s->in[k]), pace, \\
                                   _mm256_broadcastss_ps(_mm_permute_ps(early, k))); \\
        __m256 b = _mm256_fmadd_ps(BFRT_SIDES(s->out[k]), pace, \\
                                   _mm256_broadcastss_ps(_mm_permute_ps(late, k))); \\
        from = _mm256_max_ps(a, from); /* of a NaN the second is taken */ \\
        to = _mm256_min_ps(b, to); \\
    } while (0)
        BFRT_AXIS(0);
        BFRT_AXIS(1);
        BFRT_AXIS(2);
    #undef BFRT_AXIS
    #undef BFRT_SIDES
        _mm256_storeu_ps(entry, from);
        unsigned met = (unsigned)_mm256_movemask_ps(_mm256_cmp_ps(from, to, _CMP_LE_OQ));
        __m128i none = _mm_cmpeq_epi8(_mm_loadl_epi64((const __m128i *)node->count),
                                      _mm_setzero_si128());
        return met & ~(unsigned)_mm_movemask_epi8(none);
    }
    #define BFRT_HAS_AVX2 (__builtin_cpu_supports("avx2") && __builtin_cpu_supports("fma"))
    #else
    #define bfrt_spans_avx2 bfrt_spans_plain
    #define BFRT_HAS_AVX2 0
    #endif

    typedef unsigned (*bfrt_spans)(const bfrt_node *, const bfrt_sight *, float, float *);

    /* The widest that this processor has, or the plain one. Of each child the time of its entry, or
       an earlier one, comes into near; those that the ray enters by `reach` come back, as bits. */
    static inline bfrt_spans bfrt_spans_of(int plain)
    {
        return BFRT_HAS_AVX2 && !plain ? bfrt_spans_avx2 : bfrt_spans_plain;
    }

    static inline void bfrt_prefetch_node(const bfrt_node *node)
    {
        __builtin_prefetch(node);
        __builtin_prefetch((const char *)node + sizeof *node - 1);
    }
    """
    ctypedef struct Heading "bfrt_heading":
        double grow

    ctypedef struct Sight "bfrt_sight":
        double start
        double unit

    ctypedef unsigned int (*Spans "bfrt_spans")(
        const Node* node, const Sight* s, float reach, float* near
    ) noexcept nogil

    float sight_reach "bfrt_sight_reach"(const Sight* s, double t) noexcept nogil
    Spans spans_of "bfrt_spans_of"(bint plain) noexcept nogil
    void prefetch_node "bfrt_prefetch_node"(const Node* node) noexcept nogil
    void set_heading "bfrt_heading_of"(
        const double* o, const double* d, double grow, Heading* h
    ) noexcept nogil
    void set_sight "bfrt_sight_along"(
        const Heading* h, const float* base, const float* end, Sight* s
    ) noexcept nogil


cdef inline Heading heading_of(const Line* l, double grow) noexcept nogil:
    """Return a line by what its sights share; boxes are grown by `grow`."""
    cdef Heading h
    set_heading(&l.o.x, &l.d.x, grow, &h)
    return h


cdef inline Sight sight_of(const Heading* h, const Box* b) noexcept nogil:
    """Return a line as nodes in a box see it."""
    cdef Sight s
    set_sight(h, b.lo, b.hi, &s)
    return s
