"""The intersection loop: each object against the rays stored in its voxels."""

from libc.stdint cimport int64_t, uint8_t, uint32_t, uint64_t

from bfrt.geometry.box cimport Box, Span, box_empty, box_span
from bfrt.geometry.coordinates cimport Frame
from bfrt.geometry.grid cimport Grid, Range, box_range, roughly, row_faces, voxel_faces
from bfrt.geometry.lattice cimport Lattice
from bfrt.geometry.shape cimport Meeting, Shape, shape_load, shape_meet
from bfrt.geometry.vector cimport Line
from bfrt.phases.nearest cimport nearer, ray_line
from bfrt.phases.voxel_rays cimport (
    BRICK_BITS, VoxelRays, entry_face, entry_ray, entry_voxel, occupied,
)
from bfrt.records cimport INDEX_BITS, Ray
from bfrt.scene.sweep cimport Sweep, advance
from bfrt.streams.atomic cimport atomic_load, lock, unlock

cdef extern from *:
    """
    #define bfrt_prefetch(p) __builtin_prefetch(p)
    """
    void prefetch "bfrt_prefetch"(const void* p) noexcept nogil

cdef enum:
    PENDING = 64  # rays that are gathered before they are tested, against box or object

# One object's search for rays. It is set up for a sweep, and turned to object after object.
cdef struct Search:
    const Grid* grid
    Ray* rays
    uint8_t* locks
    uint32_t lock_mask
    const Frame* frame
    int kind
    const unsigned char* record
    uint32_t count
    const Box* box
    uint64_t id
    Range range
    Shape shape
    bint loaded
    int gathered
    uint32_t rays_near[PENDING]
    int pending
    Meeting meetings[PENDING]
    int64_t box_tests
    int64_t object_tests


cdef void meet_pending(Search* s) noexcept nogil:
    """Intersect the object with the rays that met its box, and keep the nearest hits."""
    cdef int i
    cdef Meeting* m
    cdef uint8_t* guard
    if not s.loaded:
        shape_load(s.kind, s.record, s.count, s.frame, &s.shape)
        s.loaded = True
    shape_meet(&s.shape, &s.meetings[0], s.pending)
    s.object_tests += s.pending
    for i in range(s.pending):
        m = &s.meetings[i]
        if m.t >= 0.0:
            guard = &s.locks[m.mark & s.lock_mask]
            lock(guard)
            nearer(&s.rays[m.mark], m.t, s.id)
            unlock(guard)
    s.pending = 0


cdef inline void meet_box(Search* s, uint32_t ray) noexcept nogil:
    """Test a ray of the box's voxels against the box itself."""
    cdef const Ray* r = &s.rays[ray]
    cdef double t = atomic_load(&r.t)
    cdef Line l
    cdef Span span
    cdef Meeting* m
    if t < 0.0:  # a shadow ray that has met something already
        return
    s.box_tests += 1
    l = ray_line(r)
    # What is nearer is culled by >, never by >=: a tie goes to the smaller id.
    if not box_span(s.box, s.grid.grow, &l, &span) or span.near > t:
        return
    m = &s.meetings[s.pending]
    m.line = l
    m.span = span
    m.mark = ray
    s.pending += 1
    if s.pending == PENDING:
        meet_pending(s)


cdef void meet_boxed(Search* s) noexcept nogil:
    """Test the gathered rays against the box."""
    cdef int i
    for i in range(s.gathered):
        meet_box(s, s.rays_near[i])
    s.gathered = 0


cdef inline void gather(Search* s, uint32_t ray) noexcept nogil:
    """Note a ray, and have it fetched from memory while others are looked for."""
    prefetch(&s.rays[ray].ox)
    prefetch(&s.rays[ray].t)
    s.rays_near[s.gathered] = ray
    s.gathered += 1
    if s.gathered == PENDING:
        meet_boxed(s)


cdef inline void meet_row(Search* s, VoxelRays v, int x0, int x1, int y, int z) noexcept nogil:
    """The rays in a row of voxels; a row's entries lie side by side."""
    cdef int64_t row = s.grid.n[0] * (y + s.grid.n[1] * <int64_t>z)
    cdef int64_t i
    cdef uint64_t entry
    cdef int faces = row_faces(&s.range, y, z)
    for i in range(v.start[row + x0], v.start[row + x1 + 1]):
        entry = v.entries[i]
        if voxel_faces(&s.range, faces, entry_voxel(entry) - row) >> entry_face(entry) & 1:
            gather(s, entry_ray(entry))


cdef void meet_brick(Search* s, VoxelRays v, int level, int bx, int by, int bz) noexcept nogil:
    """The rays in the part of the range that a brick holds."""
    cdef int at[3]
    cdef int lo[3]
    cdef int hi[3]
    cdef int k, x, y, z, below
    if not occupied(v, level, bx, by, bz):
        return
    at[0], at[1], at[2] = bx, by, bz
    below = BRICK_BITS * (level - 1)
    for k in range(3):  # in units of the level below: bricks, or at last voxels
        lo[k] = max(at[k] << BRICK_BITS, s.range.lo[k] >> below)
        hi[k] = min((at[k] << BRICK_BITS) + (1 << BRICK_BITS) - 1, s.range.hi[k] >> below)
    for z in range(lo[2], hi[2] + 1):
        for y in range(lo[1], hi[1] + 1):
            if level == 1:
                meet_row(s, v, lo[0], hi[0], y, z)
                continue
            for x in range(lo[0], hi[0] + 1):
                meet_brick(s, v, level - 1, x, y, z)


cdef inline bint rays_near(const Box* b, const Grid* g, VoxelRays v) noexcept nogil:
    """Whether any brick that the box may touch holds a ray: false for most boxes, at once.

    Arithmetic with some slack, in place of the table: it never misses a brick of the range.
    """
    cdef int lo[3]
    cdef int hi[3]
    cdef int k, x, y, z
    for k in range(3):
        lo[k] = roughly(g, k, b.lo[k], -g.slack[k]) >> BRICK_BITS
        hi[k] = roughly(g, k, b.hi[k], g.slack[k]) >> BRICK_BITS
        if hi[k] - lo[k] > 3:
            return True
    for z in range(lo[2], hi[2] + 1):
        for y in range(lo[1], hi[1] + 1):
            for x in range(lo[0], hi[0] + 1):
                if occupied(v, 1, x, y, z):
                    return True
    return False


cdef int covering_level(const Range* r, int levels) noexcept nogil:
    """The finest level of which few bricks cover a range."""
    cdef int level = 1
    cdef int k, side = 0
    for k in range(3):
        side = max(side, r.hi[k] - r.lo[k])
    while level < levels and side >> (BRICK_BITS * level) > 1:
        level += 1
    return level


cdef void meet_rays(Search* s, VoxelRays v) noexcept nogil:
    """All rays that enter the object's region."""
    cdef int level = covering_level(&s.range, v.levels)
    cdef int down = BRICK_BITS * level
    cdef int x, y, z
    for z in range(s.range.lo[2] >> down, (s.range.hi[2] >> down) + 1):
        for y in range(s.range.lo[1] >> down, (s.range.hi[1] >> down) + 1):
            for x in range(s.range.lo[0] >> down, (s.range.hi[0] >> down) + 1):
                meet_brick(s, v, level, x, y, z)
    meet_boxed(s)
    if s.pending:
        meet_pending(s)


def intersect(Sweep sweep, int64_t n, Lattice lattice, VoxelRays voxel_rays, Ray[::1] rays,
              uint8_t[::1] locks):
    """Test the next n objects of a sweep against the rays stored in their voxels.

    Parameters
    ----------
    rays : (active,) records.RAY
        IN, OUT: t and id become those of the nearest hit.
    locks : (power of 2,) uint8
        Shared by all threads; zeros.

    Returns
    -------
    box_tests, object_tests : int
    """
    cdef Search s
    cdef int64_t i
    s.grid = &lattice.grid
    s.rays = &rays[0]
    s.locks = &locks[0]
    s.lock_mask = <uint32_t>(locks.shape[0] - 1)
    s.frame = &sweep.frame
    s.kind = sweep.kind
    s.box = &sweep.box
    s.gathered = s.pending = 0
    s.box_tests = s.object_tests = 0
    with nogil:
        for i in range(n):
            s.id = (<uint64_t>sweep.number << INDEX_BITS) + <uint64_t>sweep.index
            advance(sweep)
            if box_empty(&sweep.box) or not rays_near(&sweep.box, s.grid, voxel_rays):
                continue
            s.record = sweep.record
            s.count = sweep.count
            s.loaded = False
            box_range(&lattice.grid, &sweep.box, &s.range)
            meet_rays(&s, voxel_rays)
    return s.box_tests, s.object_tests
