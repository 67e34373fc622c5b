"""The voxels of eight boxes, and the regions that a voxel's rays enter, in vector lanes: what
planes.pxd says of one at a time, to the same bits."""

from libc.stdint cimport uint8_t

from bfrt.geometry.box cimport HIGH
from bfrt.geometry.packet cimport BOXES, SIDES, BoxPacket, eight_empty  # and its C
from bfrt.grid.planes cimport Planes, Range, located  # and its BFRT_START

cdef extern from *:
    """
    #include <limits.h>

    /* Of a grid, for each side of the eight boxes. */
    typedef struct {
        double padding[BFRT_SIDES];  /* twice d, outwards */
        double first[BFRT_SIDES];    /* the first plane */
        double inverse[BFRT_SIDES];
        double slack[BFRT_SIDES];
        double last[BFRT_SIDES];     /* the last voxel */
    } bfrt_packet_planes;

    typedef struct {
        int side[6][BFRT_BOXES];
    } bfrt_voxels;

    /* The voxel of each side; whether arithmetic may differ from the table for one. All sides are
       one loop, for gcc leaves nested ones as they are. */
    BFRT_CLONES
    static int bfrt_eight_voxels(const bfrt_packet_planes *s, const bfrt_eight *e, bfrt_voxels *v)
    {
        const float *side = &e->side[0][0];
        int *voxel = &v->side[0][0];
        int differ = 0, empty = 0;
        for (int j = 0; j < BFRT_SIDES; j++) {
            double guess = ((side[j] + s->padding[j]) - s->first[j]) * s->inverse[j];
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
    """
    ctypedef struct PacketPlanes "bfrt_packet_planes":
        double padding[48]
        double first[48]
        double inverse[48]
        double slack[48]
        double last[48]

    ctypedef struct Voxels "bfrt_voxels":
        int side[6][8]

    bint voxels_unsure "bfrt_eight_voxels"(const PacketPlanes* s, const BoxPacket* e,
                                           Voxels* v) noexcept nogil
    void entered "bfrt_entered"(const Voxels* v, int n, const int (*at)[3], const uint8_t* face,
                                uint8_t* which) noexcept nogil


cdef inline void packet_planes(const Planes* g, PacketPlanes* s) noexcept nogil:
    """Copy the grid's planes to the form that `eight_voxels` works with."""
    cdef int j, k
    for j in range(SIDES):
        k = j // BOXES % 3
        s.padding[j] = (2.0 if j >= SIDES // 2 else -2.0) * g.padding
        s.first[j] = g.plane[k][0]
        s.inverse[j] = g.inverse[k]
        s.slack[j] = g.slack[k]
        s.last[j] = g.n[k] - 1


cdef inline void eight_voxels(const Planes* g, const PacketPlanes* s, const BoxPacket* e,
                              Voxels* v) noexcept nogil:
    """Find the voxels of each box, as `box_range` does; an empty one gets a range without any."""
    cdef int i, k
    if voxels_unsure(s, e, v):
        for i in range(BOXES):
            if not eight_empty(e, i):
                for k in range(6):
                    v.side[k][i] = located(g, k % 3, e.side[k][i] + s.padding[BOXES * k])


cdef inline Range range_at(const Voxels* v, int i) noexcept nogil:
    """Return the voxels of box i."""
    cdef Range r
    cdef int k
    for k in range(3):
        r.lo[k] = v.side[k][i]
        r.hi[k] = v.side[HIGH + k][i]
    return r
