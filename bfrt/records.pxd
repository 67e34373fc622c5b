"""The C twins of ``records.py``; field for field, checked by tests/test_records.py."""

from libc.stdint cimport int16_t, int64_t, uint8_t, uint16_t, uint32_t, uint64_t

cdef extern from *:
    """
    #define BFRT_NO_HIT UINT64_MAX
    """
    const uint64_t NO_HIT "BFRT_NO_HIT"

cdef enum:
    SPHERE = 0
    CONE = 1
    TRIANGLE = 2
    PATCH = 3
    POLYGON = 4
    KINDS = 5

cdef enum:
    EYE = 0
    REFLECTION = 1
    REFRACTION = 2
    SHADOW = 3

cdef enum:
    VOXEL_BITS = 30
    RAY_BITS = 21
    FACE_BITS = 3
    INDEX_BITS = 48
    KIND_BITS = 4
    STREAM_BITS = 16

cdef enum:
    BOX_BYTES = 24
    TREELET_BYTES = 48
    NODE_BYTES = 80
    CODE_BYTES = 6
    OFFSET_BYTES = 4

cdef packed struct Ray:
    double ox
    double oy
    double oz
    double dx
    double dy
    double dz
    double t        # the nearest hit so far, or where the ray ends
    uint64_t id     # of the object hit, or NO_HIT
    uint32_t voxel  # where the walk is: the first candidate of the next pass
    uint8_t face    # by which face it came there
    uint8_t kind
    uint8_t lock    # while a thread updates t and id
    uint8_t state   # whether the voxel is known to be a candidate

cdef packed struct Path:
    uint32_t pixel
    uint32_t sample
    float red
    float green
    float blue
    uint16_t kind
    int16_t power

cdef packed struct Queued:
    double ox
    double oy
    double oz
    double dx
    double dy
    double dz
    uint32_t pixel
    uint32_t sample
    float red
    float green
    float blue
    uint16_t kind
    int16_t power

cdef packed struct Hit:
    double ox
    double oy
    double oz
    double dx
    double dy
    double dz
    double t
    uint64_t id
    uint32_t pixel
    uint32_t sample
    float red
    float green
    float blue
    uint16_t kind
    int16_t power

# The path of a ray that somebody asks about: which one it is, the t that belongs to its origin.
cdef packed struct QueryPath:
    uint64_t number
    double moved
    uint32_t count  # hits, where they are counted
    uint16_t kind
    int16_t power   # of two, by which the direction was divided

# A Hit with such a path.
cdef packed struct QueryRay:
    double ox
    double oy
    double oz
    double dx
    double dy
    double dz
    double t
    uint64_t id
    uint64_t number
    double moved
    uint32_t count
    uint16_t kind
    int16_t power

# A ray that has met an object's box, and waits for its geometry.
cdef packed struct Delayed:
    uint64_t id
    int64_t first   # the object's record, or the first of a polygon's vertices
    uint32_t count  # records or vertices
    uint32_t ray    # its place among those in flight

cdef packed struct Crossing:
    double t
    uint64_t id
    uint32_t ray    # its place among those in flight
    uint32_t unused

cdef packed struct Material:
    float red
    float green
    float blue
    float kd
    float ks
    float shine
    float transmittance
    float ior

cdef packed struct Treelet:
    float lox
    float loy
    float loz
    float hix
    float hiy
    float hiz
    uint64_t first  # object, in the stream
    uint64_t node   # the first of its nodes, in the stream
    uint32_t count
    uint32_t nodes

cdef packed struct Parent:
    float lox
    float loy
    float loz
    float hix
    float hiy
    float hiz
    int64_t end  # of its children, in the level below
