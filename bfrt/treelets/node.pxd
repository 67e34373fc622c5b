"""A node of eight children, whose boxes are quantised inside its own.

::

    low, exponent     a box's side is at low + q * 2^exponent, q from 0 to 255: on each axis
    count             of each child the objects of a leaf; INNER for a node, 0 for none
    child, first      the first child that is a node, and the first object of its leaves; the others
                      follow, in the order of the children
    lo, hi            q of the sides of all children

After Ylitie, Karras and Laine, "Efficient Incoherent Ray Traversal on GPUs Through Compressed Wide
BVHs" (2017), whose node has 80 bytes too. Nodes only cull: where a ray is said to enter a box no
later, and to leave it no earlier, than it does the objects' own boxes, grown, no hit is lost. What
vector width computes that, and how it rounds, changes no answer.
"""

from libc.stdint cimport int8_t, uint8_t, uint32_t

from bfrt.geometry.box cimport Box
from bfrt.geometry.vector cimport Line

cdef extern from *:
    """
    #include <math.h>
    #include <stdint.h>
    #include <string.h>

    enum { BFRT_WIDE = 8, BFRT_INNER = 255, BFRT_QUANTA = 255, BFRT_LEAST_EXPONENT = -126 };

    typedef struct {
        float low[3];
        int8_t exponent[3];
        uint8_t inner; /* the children that are nodes, as bits */
        uint32_t child;
        uint32_t first;
        uint8_t count[BFRT_WIDE];
        uint8_t lo[3][BFRT_WIDE];
        uint8_t hi[3][BFRT_WIDE];
    } bfrt_node;

    /* 2^exponent, of exponents from -126 to 127. */
    static inline double bfrt_quantum(int exponent)
    {
        uint64_t bits = (uint64_t)(exponent + 1023) << 52;
        double quantum;
        memcpy(&quantum, &bits, 8);
        return quantum;
    }

    /* Quantise the sides lo[i] to hi[i] of n children on one axis. */
    static inline void bfrt_node_axis(bfrt_node *node, int k, const float *lo, const float *hi,
                                      int n)
    {
        float low = INFINITY, high = -INFINITY;
        for (int i = 0; i < n; i++) {
            low = lo[i] < low ? lo[i] : low;
            high = hi[i] > high ? hi[i] : high;
        }
        double base = low, extent = (double)high - base;
        int exponent;
        frexp(extent / BFRT_QUANTA, &exponent); /* 2^exponent is greater than that */
        exponent = exponent < BFRT_LEAST_EXPONENT || extent == 0.0 ? BFRT_LEAST_EXPONENT : exponent;
        double quantum = bfrt_quantum(exponent);
        node->low[k] = low;
        node->exponent[k] = (int8_t)exponent;
        for (int i = 0; i < BFRT_WIDE; i++) {
            if (i >= n) {
                node->lo[k][i] = BFRT_QUANTA;
                node->hi[k][i] = 0;
                continue;
            }
            /* The differences of floats are rounded: hence the steps back and on. */
            int a = (int)floor((lo[i] - base) / quantum), b = (int)ceil((hi[i] - base) / quantum);
            while (a > 0 && base + a * quantum > lo[i])
                a--;
            while (b < BFRT_QUANTA && base + b * quantum < hi[i])
                b++;
            node->lo[k][i] = (uint8_t)a;
            node->hi[k][i] = (uint8_t)(b > BFRT_QUANTA ? BFRT_QUANTA : b);
        }
    }

    /* A ray as nodes see it; the fourth of four is no axis. On an axis where inv is 0 the ray never
       steps (exactness rule 4): then it is `still` there. */
    typedef struct {
        double o[4];
        double inv[4];
        double room[4]; /* the time that d takes, by which objects' boxes are grown */
        double grow;
        int32_t in[3]; /* where in a node the sides are by which it enters, and leaves */
        int32_t out[3];
        int32_t still;
    } bfrt_slope;

    /* Rounding of a few float32 operations, with room; what a denormal loses. */
    #define BFRT_FLOAT_ROUNDING 0x1p-21
    #define BFRT_DENORMAL 0x1p-140

    static inline void bfrt_slope_of(const double *o, const double *inv, double grow, bfrt_slope *s)
    {
        s->still = 0;
        s->grow = grow;
        for (int k = 0; k < 3; k++) {
            s->o[k] = o[k];
            s->inv[k] = inv[k];
            s->room[k] = 1.0001 * grow * fabs(inv[k]) + BFRT_DENORMAL;
            s->in[k] = (inv[k] > 0.0 ? 0 : 3 * BFRT_WIDE) + k * BFRT_WIDE;
            s->out[k] = (inv[k] > 0.0 ? 3 * BFRT_WIDE : 0) + k * BFRT_WIDE;
            s->still |= inv[k] == 0.0;
        }
        s->o[3] = s->inv[3] = s->room[3] = 0.0;
    }

    static unsigned bfrt_node_span_plain(const bfrt_node *node, const bfrt_slope *ray, float reach,
                                         float *near)
    {
        float far[BFRT_WIDE];
        unsigned met = 0;
        for (int i = 0; i < BFRT_WIDE; i++) {
            near[i] = 0.0f;
            far[i] = reach;
        }
        for (int k = 0; k < 3; k++) {
            double quantum = bfrt_quantum(node->exponent[k]), inv = ray->inv[k];
            double from = node->low[k] - ray->o[k];
            if (inv == 0.0) {
                double room = ray->grow + BFRT_FLOAT_ROUNDING * (fabs(from) + 256.0 * quantum);
                for (int i = 0; i < BFRT_WIDE; i++)
                    if (from + node->lo[k][i] * quantum > room
                        || from + node->hi[k][i] * quantum < -room)
                        far[i] = -1.0f;
                continue;
            }
            double start = from * inv, step = quantum * inv;
            double slack = BFRT_FLOAT_ROUNDING * (fabs(start) + 256.0 * fabs(step)) + ray->room[k];
            float pace = (float)step, early = (float)(start - slack), late = (float)(start + slack);
            const uint8_t *in = node->lo[0] + ray->in[k], *out = node->lo[0] + ray->out[k];
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
    static unsigned bfrt_node_span_avx2(const bfrt_node *node, const bfrt_slope *ray, float reach,
                                        float *entry)
    {
        if (ray->still)
            return bfrt_node_span_plain(node, ray, reach, entry);
        int32_t exponents;
        memcpy(&exponents, node->exponent, sizeof exponents); /* and inner, the fourth */
        __m256d quantum = _mm256_castsi256_pd(_mm256_slli_epi64(
            _mm256_add_epi64(_mm256_cvtepi8_epi64(_mm_cvtsi32_si128(exponents)),
                             _mm256_set1_epi64x(1023)), 52));
        __m256d magnitude = _mm256_castsi256_pd(_mm256_set1_epi64x(INT64_MAX));
        __m256d inv = _mm256_loadu_pd(ray->inv);
        __m256d low = _mm256_cvtps_pd(_mm_loadu_ps(node->low));
        __m256d start = _mm256_mul_pd(_mm256_sub_pd(low, _mm256_loadu_pd(ray->o)), inv);
        __m256d step = _mm256_mul_pd(quantum, inv);
        __m256d terms = _mm256_fmadd_pd(_mm256_and_pd(step, magnitude), _mm256_set1_pd(256.0),
                                        _mm256_and_pd(start, magnitude));
        __m256d slack = _mm256_fmadd_pd(terms, _mm256_set1_pd(BFRT_FLOAT_ROUNDING),
                                        _mm256_loadu_pd(ray->room));
        __m128 paces = _mm256_cvtpd_ps(step);
        __m128 early = _mm256_cvtpd_ps(_mm256_sub_pd(start, slack));
        __m128 late = _mm256_cvtpd_ps(_mm256_add_pd(start, slack));
        __m256 near = _mm256_setzero_ps(), far = _mm256_set1_ps(reach);
    #define BFRT_SIDES(offset) _mm256_cvtepi32_ps(_mm256_cvtepu8_epi32( \\
        _mm_loadl_epi64((const __m128i *)(node->lo[0] + (offset)))))
    #define BFRT_AXIS(k) do { \\
        __m256 pace = _mm256_broadcastss_ps(_mm_permute_ps(paces, k)); \\
        __m256 a = _mm256_fmadd_ps(BFRT_SIDES(ray->in[k]), pace, \\
                                   _mm256_broadcastss_ps(_mm_permute_ps(early, k))); \\
        __m256 b = _mm256_fmadd_ps(BFRT_SIDES(ray->out[k]), pace, \\
                                   _mm256_broadcastss_ps(_mm_permute_ps(late, k))); \\
        near = _mm256_max_ps(a, near); /* of a NaN the second is taken */ \\
        far = _mm256_min_ps(b, far); \\
    } while (0)
        BFRT_AXIS(0);
        BFRT_AXIS(1);
        BFRT_AXIS(2);
    #undef BFRT_AXIS
    #undef BFRT_SIDES
        _mm256_storeu_ps(entry, near);
        unsigned met = (unsigned)_mm256_movemask_ps(_mm256_cmp_ps(near, far, _CMP_LE_OQ));
        __m128i none = _mm_cmpeq_epi8(_mm_loadl_epi64((const __m128i *)node->count),
                                      _mm_setzero_si128());
        return met & ~(unsigned)_mm_movemask_epi8(none);
    }
    #define BFRT_HAS_AVX2 (__builtin_cpu_supports("avx2") && __builtin_cpu_supports("fma"))
    #else
    #define bfrt_node_span_avx2 bfrt_node_span_plain
    #define BFRT_HAS_AVX2 0
    #endif

    typedef unsigned (*bfrt_node_spanner)(const bfrt_node *, const bfrt_slope *, float, float *);

    /* The widest that this processor has, or the plain one. Of each child the time of its entry, or
       an earlier one, comes into near; those that the ray enters by `reach` come back, as bits. */
    static inline bfrt_node_spanner bfrt_spanner(int plain)
    {
        return BFRT_HAS_AVX2 && !plain ? bfrt_node_span_avx2 : bfrt_node_span_plain;
    }
    """
    enum:
        WIDE "BFRT_WIDE"
        INNER "BFRT_INNER"

    ctypedef struct Node "bfrt_node":
        float low[3]
        int8_t exponent[3]
        uint8_t inner
        uint32_t child
        uint32_t first
        uint8_t count[8]
        uint8_t lo[3][8]
        uint8_t hi[3][8]

    ctypedef struct Slope "bfrt_slope":
        double grow

    ctypedef unsigned int (*NodeSpan "bfrt_node_spanner")(
        const Node* node, const Slope* ray, float reach, float* near
    ) noexcept nogil

    double quantum_of "bfrt_quantum"(int exponent) noexcept nogil
    void node_axis "bfrt_node_axis"(
        Node* node, int k, const float* lo, const float* hi, int n
    ) noexcept nogil
    NodeSpan node_spanner "bfrt_spanner"(bint plain) noexcept nogil
    void set_slope "bfrt_slope_of"(
        const double* o, const double* inv, double grow, Slope* s
    ) noexcept nogil


cdef inline Slope slope_of(const Line* l, double grow) noexcept nogil:
    """Return a ray as nodes see it."""
    cdef Slope s
    set_slope(&l.o.x, &l.inv.x, grow, &s)
    return s


cdef inline void node_boxes(Node* node, const Box* boxes, int n) noexcept nogil:
    """Quantise the boxes of n children, one to WIDE, none of them empty."""
    cdef float lo[8]
    cdef float hi[8]
    cdef int i, k
    for k in range(3):
        for i in range(n):
            lo[i], hi[i] = boxes[i].lo[k], boxes[i].hi[k]
        node_axis(node, k, lo, hi, n)
