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

from libc.stdint cimport int8_t, uint8_t, uint32_t, uint64_t

from bfrt.geometry.box cimport Box

cdef extern from *:
    """
    #include <math.h>
    #include <stdint.h>
    #include <string.h>

    enum { BFRT_WIDE = 8, BFRT_LARGEST_LEAF = 31, BFRT_INNER = 255 };
    enum { BFRT_QUANTA = 255, BFRT_LEAST_EXPONENT = -126 };

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

    /* Of each child that is a leaf its objects, in a byte; of others 0. */
    static inline uint64_t bfrt_leaf_counts(const bfrt_node *node)
    {
        uint64_t counts, inner;
        memcpy(&counts, node->count, 8);
        inner = (counts & 0x8080808080808080) >> 7; /* leaves have fewer than 128 */
        return counts & ~(inner * 255);
    }

    /* Of each child the objects in leaves before it, in a byte. */
    #define bfrt_before(counts) ((counts) * 0x0101010101010100u)

    /* The objects of all children that are leaves. */
    static inline uint32_t bfrt_leaf_objects(const bfrt_node *node)
    {
        uint64_t counts = bfrt_leaf_counts(node);
        return (uint32_t)((bfrt_before(counts) >> 56) + (counts >> 56));
    }

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
    """
    enum:
        WIDE "BFRT_WIDE"
        INNER "BFRT_INNER"
        LARGEST_LEAF "BFRT_LARGEST_LEAF"    # objects: those of eight are counted in a byte

    ctypedef struct Node "bfrt_node":
        float low[3]
        int8_t exponent[3]
        uint8_t inner
        uint32_t child
        uint32_t first
        uint8_t count[8]
        uint8_t lo[3][8]
        uint8_t hi[3][8]

    uint64_t objects_before "bfrt_before"(uint64_t counts) noexcept nogil
    uint64_t leaf_counts "bfrt_leaf_counts"(const Node* node) noexcept nogil
    uint32_t leaf_objects "bfrt_leaf_objects"(const Node* node) noexcept nogil
    double quantum_of "bfrt_quantum"(int exponent) noexcept nogil
    void node_axis "bfrt_node_axis"(
        Node* node, int k, const float* lo, const float* hi, int n
    ) noexcept nogil


cdef inline void node_boxes(Node* node, const Box* boxes, int n) noexcept nogil:
    """Quantise the boxes of n children, one to WIDE, none of them empty."""
    cdef float lo[8]
    cdef float hi[8]
    cdef int i, k
    for k in range(3):
        for i in range(n):
            lo[i], hi[i] = boxes[i].lo[k], boxes[i].hi[k]
        node_axis(node, k, lo, hi, n)
