"""One box against many lines, in vector lanes: what box.pxd's `padded_span` says of each.

The loop is C, for Cython has no way to ask for it in several instruction sets. The best that the
processor has is picked when the module is loaded; all give the same bits, since each is the same
IEEE operations in the same order, and never a fused one.
"""

from bfrt.geometry.box cimport PaddedBox

cdef extern from *:
    """
    #include <float.h>
    #include <math.h>

    #if defined(__x86_64__) && defined(__GLIBC__) && defined(__has_attribute)
    #if __has_attribute(target_clones) && !defined(__SANITIZE_ADDRESS__)
    #define BFRT_CLONES __attribute__((unused, target_clones("avx512f", "avx2", "default")))
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
    """
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


cdef inline void padded_lanes(Lanes* l, int n, const PaddedBox* g) noexcept nogil:
    """Set near and far of the first n lines, from their o and d."""
    lanes_span(l, n, &g.lo[0], &g.hi[0])
