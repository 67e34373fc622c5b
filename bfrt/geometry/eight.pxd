"""Eight boxes side by side, in vector lanes: the regions that a voxel's rays enter, and the boxes
that one line meets. The other way round, one box against many lines, is lanes.pxd's, whose
BFRT_CLONES and whose promise of the same bits hold here too.
"""

from libc.stdint cimport uint8_t

from bfrt.geometry.box cimport Box, box_empty
from bfrt.geometry.grid cimport HIGH, START, Range
from bfrt.geometry.lanes cimport BOXES

cdef extern from *:
    """
    enum { BFRT_FACES = 7 };

    /* The voxels of eight boxes; and for each face by which a ray comes into a voxel, the last
       place on its axis where it enters the box so. High faces have all signs turned. */
    typedef struct {
        int lo[3][8];
        int hi[3][8];
        int entry[BFRT_FACES][8];
    } bfrt_regions;

    /* Which of the eight a ray enters that comes into each of n voxels by a face, as bits. */
    BFRT_CLONES
    static void bfrt_entered(const bfrt_regions *r, int n, const int (*at)[3],
                             const uint8_t *face, uint8_t *which)
    {
        for (int j = 0; j < n; j++) {
            int x = at[j][0], y = at[j][1], z = at[j][2], f = face[j];
            int here = f < 3 ? at[j][f] : f < 6 ? -at[j][f - 3] : 0;
            int bits = 0;
            for (int i = 0; i < 8; i++) {
                int in = (r->lo[0][i] <= x) & (x <= r->hi[0][i]) & (r->lo[1][i] <= y)
                    & (y <= r->hi[1][i]) & (r->lo[2][i] <= z) & (z <= r->hi[2][i])
                    & (here <= r->entry[f][i]);
                bits |= in << i;
            }
            which[j] = (uint8_t)bits;
        }
    }

    /* Eight boxes as rays meet them. */
    typedef struct {
        double lo[3][8];
        double hi[3][8];
    } bfrt_eight;

    /* Where a line, from t = 0 on, is inside each of eight boxes: near > far for nowhere. */
    BFRT_CLONES
    static void bfrt_eight_span(const bfrt_eight *b, const double *o, const double *d, double *inv,
                                double *near, double *far)
    {
        for (int i = 0; i < 8; i++) {
            near[i] = 0.0;
            far[i] = INFINITY;
        }
        for (int k = 0; k < 3; k++) {
            const double *lo = b->lo[k], *hi = b->hi[k];
            double raw = 1.0 / d[k], from = o[k];
            double step = inv[k] = fabs(raw) <= DBL_MAX ? raw : 0.0;
            for (int i = 0; i < 8; i++) {
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
    }
    """
    ctypedef struct Regions "bfrt_regions":
        int lo[3][8]
        int hi[3][8]
        int entry[7][8]

    void entered "bfrt_entered"(const Regions* r, int n, const int (*at)[3], const uint8_t* face,
                                uint8_t* which) noexcept nogil

    ctypedef struct Eight "bfrt_eight":
        double lo[3][8]
        double hi[3][8]

    void eight_span "bfrt_eight_span"(const Eight* b, const double* o, const double* d, double* inv,
                                      double* near, double* far) noexcept nogil


cdef inline void regions_of(const Range* ranges, const Range* least, const Box* boxes, int n,
                            Regions* r) noexcept nogil:
    """Of n boxes, BOXES or fewer, their voxels and what they hold at the least: `entered_by` for
    all of them. The rest of the eight, and those without a point, nothing enters."""
    cdef int i, k
    for i in range(BOXES):
        if i >= n or box_empty(&boxes[i]):
            r.lo[0][i], r.hi[0][i] = 1, 0
            continue
        for k in range(3):
            r.lo[k][i], r.hi[k][i] = ranges[i].lo[k], ranges[i].hi[k]
            r.entry[k][i], r.entry[HIGH + k][i] = least[i].lo[k], -least[i].hi[k]
        r.entry[START][i] = 0


cdef inline void eight_of(const Box* boxes, int n, double grow, Eight* e) noexcept nogil:
    """The first n boxes as rays meet them; in place of the rest of the eight, the first again."""
    cdef const Box* b
    cdef int i, k
    for i in range(BOXES):
        b = &boxes[i if i < n else 0]
        for k in range(3):
            e.lo[k][i] = b.lo[k] - grow
            e.hi[k][i] = b.hi[k] + grow
