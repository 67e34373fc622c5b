"""The intersection loop: each object against the rays stored in its voxels.

Objects are looked at eight at a time. Where few rays wait in the voxels of the eight, these are
gathered once and each is tested against the eight boxes; where many do, each object looks for its
own, and its box is tested against those in lanes.
"""

from libc.stdint cimport int64_t, uint8_t, uint32_t, uint64_t

from bfrt.geometry.box cimport Box, Grown, box_empty, box_grow, grown_span
from bfrt.geometry.eight cimport (
    BOXES, GrownEight, Sides, Voxels, eight_empty, eight_grow, eight_span, eight_union,
    eight_voxels, entered, grown_at, range_at, sides_of,
)
from bfrt.geometry.grid cimport Grid, Range, entered_by, rough_range
from bfrt.geometry.lanes cimport LANES, Lanes, grown_lanes
from bfrt.geometry.lattice cimport Lattice
from bfrt.geometry.quantised cimport coded_union
from bfrt.geometry.shape cimport Meeting, Shape, shape_bounds, shape_load, shape_meet
from bfrt.geometry.vector cimport Vec, vec
from bfrt.phases.crossings cimport Found, cross, hand_over
from bfrt.phases.nearby cimport Near, entries_within
from bfrt.phases.nearest cimport nearer
from bfrt.phases.voxel_rays cimport VoxelRays
from bfrt.records cimport INDEX_BITS, Crossing, Ray
from bfrt.scene.sweep cimport Sweep, advance_block, advance_to, decode, fetch
from bfrt.streams.atomic cimport atomic_load, lock, unlock

cdef extern from *:
    """
    #define bfrt_prefetch(p) __builtin_prefetch(p)
    #define bfrt_ones(bits) __builtin_popcount(bits)
    """
    void prefetch "bfrt_prefetch"(const void* p) noexcept nogil
    int ones "bfrt_ones"(unsigned int bits) noexcept nogil

# The few rays that are near a block of objects: which regions each enters, where it is inside the
# boxes, and of each object the rays that meet its box.
cdef struct Few:
    uint8_t which[LANES]
    double inv[LANES][3]
    double near[LANES][BOXES]
    double far[LANES][BOXES]
    uint8_t met[BOXES][LANES]
    int count[BOXES]

# One object's search for rays. It is set up for a sweep, and turned to object after object.
cdef struct Search:
    const Grid* grid
    Sides sides
    Ray* rays
    void* sweep            # a Sweep
    GrownEight grown       # the boxes of the sweep's block
    Voxels voxels          # theirs
    Near near
    uint64_t id
    int place              # of the object in the block
    Grown box
    Grown own              # the object's own box, where the other is quantised
    bint degenerate        # and whether it has none
    Range region           # the object's voxels
    Shape shape
    bint loaded
    int gathered
    uint32_t rays_near[LANES]  # rays that enter the region, before they are tested together
    double reach[LANES]        # of each its nearest hit so far
    Lanes lanes
    int pending
    Meeting meetings[LANES]
    Found* found           # all hits are wanted, or NULL: the nearest
    int64_t box_tests
    int64_t object_tests


cdef int cross_pending(Search* s) except -1 nogil:
    """Keep all hits."""
    cdef int i
    cdef Meeting* m
    for i in range(s.pending):
        m = &s.meetings[i]
        cross(s.found, &s.shape, m, s.rays[m.mark].t, s.id)
    return 0


cdef int load(Search* s, Sweep w) except -1 nogil:
    """Fetch the object's geometry; where its box is quantised, work that out as it was."""
    cdef const unsigned char* record = fetch(w, s.place)
    cdef bint whole = shape_load(w.kind, record, w.count, &w.frame, &s.shape)
    cdef Box box
    s.loaded = True
    if w.coded:
        s.degenerate = not whole
        if whole:
            shape_bounds(&s.shape, &box)
            box_grow(&box, s.grid.grow, &s.own)
    return 0


cdef void meet_own_box(Search* s) noexcept nogil:
    """Of the rays that met the quantised box, keep those that meet the object's own."""
    cdef int i, n = 0
    cdef Meeting* m
    for i in range(s.pending):
        m = &s.meetings[i]
        if not s.degenerate and grown_span(&s.own, &m.line, &m.span):
            if m.span.near <= atomic_load(&s.rays[m.mark].t):
                s.meetings[n] = m[0]
                n += 1
    s.pending = n


cdef int meet_pending(Search* s, Sweep w) except -1 nogil:
    """Intersect the object with the rays that met its box, and keep the nearest hits, or all.

    Its geometry is fetched for the first of them (the paper's refinement G).
    """
    cdef int i
    cdef Meeting* m
    cdef Ray* r
    if not s.loaded:
        load(s, w)
    if w.coded:
        meet_own_box(s)
    s.object_tests += s.pending
    if s.found != NULL:
        cross_pending(s)
        s.pending = 0
        return 0
    shape_meet(&s.shape, &s.meetings[0], s.pending)
    for i in range(s.pending):
        m = &s.meetings[i]
        r = &s.rays[m.mark]
        if 0.0 <= m.t <= atomic_load(&r.t):
            lock(&r.lock)
            nearer(r, m.t, s.id)
            unlock(&r.lock)
    s.pending = 0
    return 0


cdef inline void wait_for(Search* s, uint32_t ray, Vec inv, double near,
                          double far) noexcept nogil:
    """Have a ray that met the box wait for the object."""
    cdef const Ray* r = &s.rays[ray]
    cdef Meeting* m = &s.meetings[s.pending]
    m.line.o = vec(r.ox, r.oy, r.oz)
    m.line.d = vec(r.dx, r.dy, r.dz)
    m.line.inv = inv
    m.span.near, m.span.far = near, far
    m.mark = ray
    s.pending += 1


cdef inline void fetch_ray(const Search* s, uint32_t ray) noexcept nogil:
    """Have a ray fetched from memory, which is on two lines of it, while others are looked at."""
    prefetch(&s.rays[ray].ox)
    prefetch(&s.rays[ray].t)


cdef int meet_box(Search* s, Sweep w) except -1 nogil:
    """Test the gathered rays against the box; those that meet it are pending."""
    cdef Lanes* l = &s.lanes
    cdef const Ray* r
    cdef Vec inv
    cdef double t
    cdef uint32_t ray
    cdef int i, n = 0
    for i in range(s.gathered):
        ray = s.rays_near[i]
        r = &s.rays[ray]
        t = atomic_load(&r.t)
        if t < 0.0:  # a shadow ray that has met something already
            continue
        s.rays_near[n] = ray
        s.reach[n] = t
        l.o[0][n], l.o[1][n], l.o[2][n] = r.ox, r.oy, r.oz
        l.d[0][n], l.d[1][n], l.d[2][n] = r.dx, r.dy, r.dz
        n += 1
    s.gathered = 0
    s.box_tests += n
    grown_lanes(l, n, &s.box)
    for i in range(n):
        # What is nearer is culled by >, never by >=: a tie goes to the smaller id.
        if not l.near[i] <= l.far[i] or l.near[i] > s.reach[i]:
            continue
        if s.pending == LANES:
            meet_pending(s, w)
        inv = vec(l.inv[0][i], l.inv[1][i], l.inv[2][i])
        wait_for(s, s.rays_near[i], inv, l.near[i], l.far[i])
    return 0


cdef int keep_entering(void* context) except -1 nogil:
    """Keep the rays, of the entries that were gathered, that enter the object's region."""
    cdef Search* s = <Search*>context
    cdef Near* near = &s.near
    cdef int j
    if s.gathered + near.n > LANES:
        meet_box(s, <Sweep>s.sweep)
    for j in range(near.n):
        if entered_by(&s.region, near.at[j][0], near.at[j][1], near.at[j][2]) >> near.face[j] & 1:
            fetch_ray(s, near.ray[j])
            s.rays_near[s.gathered] = near.ray[j]
            s.gathered += 1
    near.n = 0
    return 0


cdef inline void turn_to(Search* s, Sweep w, int place) noexcept nogil:
    """Go on to another object of the block."""
    s.place = place
    s.id = (<uint64_t>w.number << INDEX_BITS) + <uint64_t>(w.first + place)
    s.loaded = False


cdef int meet_many(Search* s, Sweep w, VoxelRays v, int n) except -1 nogil:
    """The n objects of a block, each against the rays in its voxels."""
    cdef int i
    s.near.spill = keep_entering
    for i in range(n):
        if not eight_empty(&w.eight, i):
            turn_to(s, w, i)
            grown_at(&s.grown, i, &s.box)
            s.region = range_at(&s.voxels, i)
            entries_within(&s.region, v, &s.near)
            keep_entering(s)
            meet_box(s, w)
            if s.pending:
                meet_pending(s, w)
    return 0


cdef int choose(Near* near, const Voxels* voxels, uint8_t* which) noexcept nogil:
    """Keep the rays that enter any of the regions, and which; returns how many."""
    cdef int j, n = 0
    entered(voxels, near.n, near.at, &near.face[0], which)
    for j in range(near.n):
        if which[j]:
            near.ray[n], which[n] = near.ray[j], which[j]
            n += 1
    return n


cdef void test_boxes(Search* s, int n, int rays, Few* f) noexcept nogil:
    """Test each ray against the eight boxes, and note which of the n objects it meets."""
    cdef const Ray* r
    cdef double t
    cdef int i, j
    for i in range(n):
        f.count[i] = 0
    for j in range(rays):
        r = &s.rays[s.near.ray[j]]
        t = atomic_load(&r.t)
        if t < 0.0:  # a shadow ray that has met something already
            continue
        s.box_tests += ones(f.which[j])
        eight_span(&s.grown, &r.ox, &r.dx, &f.inv[j][0], &f.near[j][0], &f.far[j][0])
        for i in range(n):
            if f.which[j] >> i & 1 and f.near[j][i] <= f.far[j][i] and f.near[j][i] <= t:
                f.met[i][f.count[i]] = <uint8_t>j
                f.count[i] += 1


cdef int meet_few(Search* s, Sweep w, int n) except -1 nogil:
    """The n objects of a block, all against the few rays that are near any of them."""
    cdef Few few
    cdef Vec inv
    cdef int i, j, k, rays
    rays = choose(&s.near, &s.voxels, &few.which[0])
    for j in range(rays):
        fetch_ray(s, s.near.ray[j])
    test_boxes(s, n, rays, &few)
    for i in range(n):
        if few.count[i]:
            turn_to(s, w, i)
            for k in range(few.count[i]):
                j = few.met[i][k]
                # Unless what it met since is nearer.
                if not few.near[j][i] > atomic_load(&s.rays[s.near.ray[j]].t):
                    inv = vec(few.inv[j][0], few.inv[j][1], few.inv[j][2])
                    wait_for(s, s.near.ray[j], inv, few.near[j][i], few.far[j][i])
            if s.pending:
                meet_pending(s, w)
    return 0


cdef int meet_block(Search* s, Sweep w, VoxelRays v, int n) except -1 nogil:
    """The n objects of a block against the rays in their voxels: half of the blocks have none."""
    cdef Box all
    cdef Range around
    if w.coded:
        coded_union(&w.coding, w.codes, n, <float*>&all)
    else:
        eight_union(&w.eight, <float*>&all)
    if box_empty(&all):
        return 0
    around = rough_range(s.grid, &all)
    s.near.spill = NULL
    entries_within(&around, v, &s.near)
    if s.near.n == 0:
        return 0
    decode(w, n)
    eight_grow(&w.eight, s.grid.grow, &s.grown)
    eight_voxels(s.grid, &s.sides, &w.eight, &s.voxels)
    if s.near.more:
        return meet_many(s, w, v, n)
    return meet_few(s, w, n)


def intersect(Sweep sweep, const int64_t[:, ::1] ranges, const float[:, ::1] parents,
              Lattice lattice, VoxelRays voxel_rays, Ray[::1] rays, Crossing[::1] crossings=None,
              emit=None):
    """Test objects of a sweep against the rays stored in their voxels.

    Parameters
    ----------
    ranges : (n, 2) int64
        IN. First and end of runs of objects, ascending, in the sweep's window.
    parents : (n, 6) float32, optional
        IN. The box around the objects of each run, in which theirs are quantised: those are read
        then. The rays have to be stored by marks of those boxes.
    rays : (active,) records.RAY
        IN, OUT: t and id become those of the nearest hit. Threads share them.
    crossings : (room,) records.CROSSING, optional
        Where all hits are wanted: a buffer. The rays stay as they are.
    emit : callable, optional
        Called with how many of them there are when it is full, and at the end.

    Returns
    -------
    box_tests, object_tests : int
    """
    cdef Search s
    cdef Found found
    cdef const Box* parent = NULL
    cdef int64_t k
    cdef int n
    s.found = NULL
    if crossings is not None:
        found.crossings, found.n, found.room = &crossings[0], 0, crossings.shape[0]
        found.emit = <void*>emit
        s.found = &found
    s.grid = &lattice.grid
    sides_of(s.grid, &s.sides)
    s.rays = &rays[0]
    s.sweep = <void*>sweep
    s.near.context = &s
    s.gathered = s.pending = 0
    s.box_tests = s.object_tests = 0
    with nogil:
        for k in range(ranges.shape[0]):
            if parents is not None:
                parent = <const Box*>&parents[k, 0]
            advance_to(sweep, ranges, k, parent)
            while sweep.index < ranges[k, 1]:
                n = advance_block(sweep, ranges[k, 1] - sweep.index)
                meet_block(&s, sweep, voxel_rays, n)
        if s.found != NULL:
            hand_over(s.found)
    return s.box_tests, s.object_tests
