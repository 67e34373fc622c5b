"""A ray's walk through the slab in memory: the candidates that it takes, and its sentinel."""

from libc.stdint cimport int32_t, int64_t, uint8_t, uint32_t, uint64_t
from libc.string cimport memcpy

from bfrt.grid.bricks cimport BRICK_SHIFT, CUBE_SHIFT, DARK, DARK_SHIFT, EMPTY_CUBE
from bfrt.grid.planes cimport NOWHERE, START
from bfrt.grid.slabs cimport Slab, brick_at, mark_at
from bfrt.grid.voxel_rays cimport VoxelRays, entry_of, voxel_of
from bfrt.grid.walk cimport Walk, walk_leave, walk_step
from bfrt.records cimport Ray
from bfrt.streams.atomic cimport atomic_fetch_add

# What is known of the voxel where a ray's walk is.
cdef enum:
    CANDIDATE = 0  # it is a candidate: the next that is taken
    UNSEEN = 1     # its marks have not been looked at

cdef enum:
    GATHERED = 128  # candidates that a thread puts into memory together

# Candidates on their way from one thread into memory that all share, and the ray that takes them.
cdef struct Outgoing:
    uint64_t entries[GATHERED]
    int n
    uint64_t* slots
    int64_t* used
    uint32_t ray    # its place in the pool
    uint32_t* left  # candidates that it may still take


cdef inline void flush(Outgoing* out) noexcept nogil:
    """Put what was gathered into memory."""
    cdef int64_t at = atomic_fetch_add(out.used, out.n)
    memcpy(&out.slots[at], &out.entries[0], out.n * sizeof(uint64_t))
    out.n = 0


cdef inline void put(Outgoing* out, uint64_t entry) noexcept nogil:
    out.entries[out.n] = entry
    out.n += 1
    if out.n == GATHERED:
        flush(out)


cdef inline bint walk_on(int32_t brick, uint8_t mark, Walk* w) noexcept nogil:
    """Step to the next voxel, or out of a cube without marks; false where the grid ends."""
    if brick >= 0:
        return walk_leave(w, DARK_SHIFT) if mark & DARK else walk_step(w)
    return walk_leave(w, CUBE_SHIFT if brick == EMPTY_CUBE else BRICK_SHIFT)


cdef inline int slab_of(const Slab* s, const Ray* r) noexcept nogil:
    """Return the slab that a ray's voxel is in."""
    return s.slab_of[r.voxel // <uint32_t>s.planes.stride[s.axis] >> BRICK_SHIFT]


cdef inline int64_t walk_ray(const Slab* s, Walk* w, Ray* r, VoxelRays v,
                             Outgoing* out) noexcept nogil:
    """Walk through the slab, until the sentinel is found; return the voxels stepped to.

    A ray that comes into a brick of another slab has that voxel as its state, unseen. Bricks that
    are not there have no slab.
    """
    cdef int64_t steps = 0
    cdef bint candidate = r.state == CANDIDATE
    cdef int32_t brick
    cdef uint8_t mark
    r.state = CANDIDATE
    while True:
        brick = brick_at(s, &w.at[0])
        if brick >= 0:
            if s.slab_of[w.at[s.axis] >> BRICK_SHIFT] != s.number:
                r.voxel, r.face = w.voxel, <uint8_t>w.face
                r.state = UNSEEN
                return steps
            mark = mark_at(s, brick, &w.at[0])
        else:
            mark = 0
        if not candidate:
            steps += 1
            candidate = w.face == START or mark >> w.face & 1
        if candidate:
            if out.left[0] == 0:
                r.voxel, r.face = w.voxel, <uint8_t>w.face
                return steps
            out.left[0] -= 1
            put(out, entry_of(voxel_of(v, &w.at[0]), out.ray, w.face))
            candidate = False
        if not walk_on(brick, mark, w) or w.enter > r.t:
            r.voxel = NOWHERE
            return steps
