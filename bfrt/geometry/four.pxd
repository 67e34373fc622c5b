"""Four records side by side: which of them a ray may meet.

Those left out are missed by the same arithmetic, to the last bit, as one record is tested with
(triangle.pxd, sphere.pxd, cone.pxd); the others are tested one by one. Where the processor lacks
the vectors, or records are float64, none is left out here.
"""

from libc.stdint cimport int32_t

from bfrt.geometry.outline cimport Shear
from bfrt.geometry.vector cimport Line, dot
from bfrt.records cimport CONE, PATCH, SPHERE, TRIANGLE

cdef extern from *:
    """
    #include <stddef.h>
    #include <stdint.h>

    typedef struct {
        double o[3], d[3];
        double square; /* d.d */
        int32_t k; /* the axis of d's largest part */
    } bfrt_four_ray;

    #if defined(__x86_64__) && defined(__GNUC__)
    #include <immintrin.h>

    #define BFRT_DOT(a, b) _mm256_add_pd( \\
        _mm256_add_pd(_mm256_mul_pd(a[0], b[0]), _mm256_mul_pd(a[1], b[1])), \\
        _mm256_mul_pd(a[2], b[2]))

    /* Where each of four is, of the n that there are: the last again and again. */
    #define BFRT_FOUR(i) (records + ((i) < n ? (i) : n - 1) * stride)

    __attribute__((target("avx2")))
    static unsigned bfrt_four_triangles(const unsigned char *records, size_t stride, int n,
                                        const bfrt_four_ray *ray)
    {
        __m128 part[12], last[4];
        for (int i = 0; i < 4; i++) {
            const float *r = (const float *)BFRT_FOUR(i);
            part[i] = _mm_loadu_ps(r);
            part[4 + i] = _mm_loadu_ps(r + 4);
            last[i] = _mm_load_ss(r + 8);
        }
        _MM_TRANSPOSE4_PS(part[0], part[1], part[2], part[3]);
        _MM_TRANSPOSE4_PS(part[4], part[5], part[6], part[7]);
        part[8] = _mm_movelh_ps(_mm_unpacklo_ps(last[0], last[1]),
                                _mm_unpacklo_ps(last[2], last[3]));
        int kz = ray->k, kx = kz == 2 ? 0 : kz + 1, ky = kz == 0 ? 2 : kz - 1;
        __m256d ox = _mm256_broadcast_sd(&ray->o[kx]), dx = _mm256_broadcast_sd(&ray->d[kx]);
        __m256d oy = _mm256_broadcast_sd(&ray->o[ky]), dy = _mm256_broadcast_sd(&ray->d[ky]);
        __m256d oz = _mm256_broadcast_sd(&ray->o[kz]), dz = _mm256_broadcast_sd(&ray->d[kz]);
        __m256d x[3], y[3];
        for (int v = 0; v < 3; v++) {
            __m256d qx = _mm256_sub_pd(_mm256_cvtps_pd(part[3 * v + kx]), ox);
            __m256d qy = _mm256_sub_pd(_mm256_cvtps_pd(part[3 * v + ky]), oy);
            __m256d qz = _mm256_sub_pd(_mm256_cvtps_pd(part[3 * v + kz]), oz);
            x[v] = _mm256_sub_pd(_mm256_mul_pd(qx, dz), _mm256_mul_pd(qz, dx));
            y[v] = _mm256_sub_pd(_mm256_mul_pd(qy, dz), _mm256_mul_pd(qz, dy));
        }
        __m256d zero = _mm256_setzero_pd(), below = zero, above = zero;
        for (int v = 0; v < 3; v++) {
            int w = v == 2 ? 0 : v + 1;
            /* Where the products are equal this is 0, and says nothing. */
            __m256d side = _mm256_sub_pd(_mm256_mul_pd(x[w], y[v]), _mm256_mul_pd(y[w], x[v]));
            below = _mm256_or_pd(below, _mm256_cmp_pd(side, zero, _CMP_LT_OQ));
            above = _mm256_or_pd(above, _mm256_cmp_pd(side, zero, _CMP_GT_OQ));
        }
        return ~(unsigned)_mm256_movemask_pd(_mm256_and_pd(below, above)) & ((1u << n) - 1);
    }

    __attribute__((target("avx2")))
    static unsigned bfrt_four_spheres(const unsigned char *records, size_t stride, int n,
                                      const bfrt_four_ray *ray)
    {
        __m128 part[4];
        for (int i = 0; i < 4; i++)
            part[i] = _mm_loadu_ps((const float *)BFRT_FOUR(i));
        _MM_TRANSPOSE4_PS(part[0], part[1], part[2], part[3]);
        __m256d co[3], d[3];
        for (int k = 0; k < 3; k++) {
            d[k] = _mm256_broadcast_sd(&ray->d[k]);
            co[k] = _mm256_sub_pd(_mm256_broadcast_sd(&ray->o[k]), _mm256_cvtps_pd(part[k]));
        }
        __m256d b = BFRT_DOT(co, d);
        __m256d t = _mm256_div_pd(_mm256_xor_pd(b, _mm256_set1_pd(-0.0)),
                                  _mm256_broadcast_sd(&ray->square));
        for (int k = 0; k < 3; k++)
            co[k] = _mm256_add_pd(co[k], _mm256_mul_pd(d[k], t));
        __m256d away = BFRT_DOT(co, co);
        __m256d r = _mm256_cvtps_pd(part[3]);
        __m256d room = _mm256_sub_pd(_mm256_mul_pd(r, r), away);
        return (unsigned)_mm256_movemask_pd(_mm256_cmp_pd(room, _mm256_setzero_pd(), _CMP_GE_OQ))
            & ((1u << n) - 1);
    }

    __attribute__((target("avx2")))
    static unsigned bfrt_four_cones(const unsigned char *records, size_t stride, int n,
                                    const bfrt_four_ray *ray)
    {
        __m128 part[8];
        for (int i = 0; i < 4; i++) {
            part[i] = _mm_loadu_ps((const float *)BFRT_FOUR(i));
            part[4 + i] = _mm_loadu_ps((const float *)BFRT_FOUR(i) + 4);
        }
        _MM_TRANSPOSE4_PS(part[0], part[1], part[2], part[3]);
        _MM_TRANSPOSE4_PS(part[4], part[5], part[6], part[7]);
        __m256d sign = _mm256_set1_pd(-0.0), zero = _mm256_setzero_pd(), one = _mm256_set1_pd(1.0);
        __m256d axis[3], co[3], d[3], middle[3], p[3], v[3], turned[3], moment[3];
        for (int k = 0; k < 3; k++) {
            __m256d base = _mm256_cvtps_pd(part[k]);
            d[k] = _mm256_broadcast_sd(&ray->d[k]);
            axis[k] = _mm256_sub_pd(_mm256_cvtps_pd(part[4 + k]), base);
            co[k] = _mm256_sub_pd(_mm256_broadcast_sd(&ray->o[k]), base);
            middle[k] = _mm256_sub_pd(_mm256_mul_pd(axis[k], _mm256_set1_pd(0.5)), co[k]);
        }
        __m256d length2 = BFRT_DOT(axis, axis);
        __m256d rb = _mm256_andnot_pd(sign, _mm256_cvtps_pd(part[3]));
        __m256d wider = _mm256_sub_pd(_mm256_andnot_pd(sign, _mm256_cvtps_pd(part[7])), rb);
        __m256d shift = _mm256_div_pd(BFRT_DOT(middle, d), _mm256_broadcast_sd(&ray->square));
        for (int k = 0; k < 3; k++)
            co[k] = _mm256_add_pd(co[k], _mm256_mul_pd(d[k], shift));
        __m256d s0 = _mm256_div_pd(BFRT_DOT(co, axis), length2);
        __m256d ds = _mm256_div_pd(BFRT_DOT(d, axis), length2);
        for (int k = 0; k < 3; k++) {
            p[k] = _mm256_add_pd(co[k], _mm256_mul_pd(axis[k], _mm256_xor_pd(s0, sign)));
            v[k] = _mm256_add_pd(d[k], _mm256_mul_pd(axis[k], _mm256_xor_pd(ds, sign)));
        }
        __m256d r0 = _mm256_add_pd(rb, _mm256_mul_pd(s0, wider)), dr = _mm256_mul_pd(ds, wider);
        for (int k = 0; k < 3; k++) {
            int y = k == 2 ? 0 : k + 1, z = k == 0 ? 2 : k - 1;
            turned[k] = _mm256_sub_pd(_mm256_mul_pd(v[k], r0), _mm256_mul_pd(p[k], dr));
            moment[k] = _mm256_sub_pd(_mm256_mul_pd(p[y], v[z]), _mm256_mul_pd(p[z], v[y]));
        }
        __m256d room = _mm256_sub_pd(BFRT_DOT(turned, turned), BFRT_DOT(moment, moment));
        __m256d some = _mm256_cmp_pd(room, zero, _CMP_GE_OQ);
        if (!_mm256_movemask_pd(some))
            return 0;
        __m256d a = _mm256_sub_pd(BFRT_DOT(v, v), _mm256_mul_pd(dr, dr));
        __m256d b = _mm256_sub_pd(BFRT_DOT(p, v), _mm256_mul_pd(r0, dr));
        __m256d root = _mm256_sqrt_pd(room);
        __m256d q = _mm256_blendv_pd(_mm256_sub_pd(root, b),
                                     _mm256_xor_pd(_mm256_add_pd(b, root), sign),
                                     _mm256_cmp_pd(b, zero, _CMP_GE_OQ));
        __m256d t[2] = {
            _mm256_div_pd(q, a),
            _mm256_div_pd(_mm256_sub_pd(BFRT_DOT(p, p), _mm256_mul_pd(r0, r0)), q),
        };
        __m256d between = zero;
        for (int k = 0; k < 2; k++) {
            __m256d s = _mm256_add_pd(s0, _mm256_mul_pd(t[k], ds));
            between = _mm256_or_pd(between, _mm256_and_pd(
                _mm256_cmp_pd(_mm256_add_pd(t[k], shift), zero, _CMP_GT_OQ),
                _mm256_and_pd(_mm256_cmp_pd(s, zero, _CMP_GE_OQ),
                              _mm256_cmp_pd(s, one, _CMP_LE_OQ))));
        }
        return (unsigned)_mm256_movemask_pd(_mm256_and_pd(some, between)) & ((1u << n) - 1);
    }
    #undef BFRT_FOUR
    #undef BFRT_DOT
    #define BFRT_HAS_FOUR __builtin_cpu_supports("avx2")
    #else
    #define bfrt_four_triangles 0
    #define bfrt_four_spheres 0
    #define bfrt_four_cones 0
    #define BFRT_HAS_FOUR 0
    #endif

    typedef unsigned (*bfrt_four_test)(const unsigned char *, size_t, int, const bfrt_four_ray *);
    """
    ctypedef struct FourRay "bfrt_four_ray":
        double o[3]
        double d[3]
        double square
        int32_t k

    # Of n records, one to four, those that the ray may meet, as bits.
    ctypedef unsigned int (*FourTest "bfrt_four_test")(
        const unsigned char* records, size_t stride, int n, const FourRay* ray
    ) noexcept nogil

    bint HAS_FOUR "BFRT_HAS_FOUR"
    FourTest four_triangles "bfrt_four_triangles"
    FourTest four_spheres "bfrt_four_spheres"
    FourTest four_cones "bfrt_four_cones"


cdef inline FourTest four_test(int kind, bint wide, bint plain) noexcept nogil:
    """Return the test of a kind's records, or NULL for none."""
    if wide or plain or not HAS_FOUR:
        return NULL
    if kind == SPHERE:
        return four_spheres
    if kind == CONE:
        return four_cones
    if kind == TRIANGLE or kind == PATCH:
        return four_triangles
    return NULL


cdef inline FourRay four_ray(const Line* l, const Shear* seen) noexcept nogil:
    """Return a ray as four records see it."""
    cdef FourRay ray
    ray.o[0], ray.o[1], ray.o[2] = l.o.x, l.o.y, l.o.z
    ray.d[0], ray.d[1], ray.d[2] = l.d.x, l.d.y, l.d.z
    ray.square = dot(l.d, l.d)
    ray.k = seen.k
    return ray
