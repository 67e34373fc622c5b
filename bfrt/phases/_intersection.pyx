"""The intersection loop: each object against the rays stored in its voxels.

Objects are looked at eight at a time. Where few rays wait in the voxels of the eight, these are
gathered once and each is tested against the eight boxes; where many do, each object looks for its
own, and its box is tested against those in lanes. Rays that meet a box are tested against the
object at once where its geometry is at hand; otherwise they wait for it (deferred.pxd).
"""

cimport cython
from libc.stdint cimport int64_t, uint8_t, uint32_t, uint64_t

from bfrt.bits cimport lowest_bit, ones
from bfrt.geometry.box cimport Box, Grown, box_empty, box_grow, grown_span
from bfrt.geometry.packet cimport BOXES, PaddedPacket, eight_empty, eight_grow, eight_span, grown_at
from bfrt.grid.regions cimport Sides, Voxels, eight_voxels, entered, range_at, sides_of
from bfrt.grid.planes cimport Planes, Range, entered_by, rough_range
from bfrt.geometry.lanes cimport LANES, Lanes, grown_lanes
from bfrt.grid.grid cimport Grid
from bfrt.geometry.shape cimport BoxHit, Shape, shape_bounds, shape_load, shape_meet
from bfrt.geometry.vector cimport Vec, vec
from bfrt.phases.all_hits cimport Found, cross, hand_over
from bfrt.scan.deferred cimport (
    DeferredTests, ask_piece, delay, end_delays, full, piece_end, turn,
)
from bfrt.grid.nearby cimport Near, entries_within
from bfrt.phases.nearest cimport nearer, ray_line
from bfrt.grid.voxel_rays cimport VoxelRays
from bfrt.records cimport INDEX_BITS, POLYGON, Crossing, Delayed, Ray
from bfrt.scan.boxes cimport BoxCursor, block_union, decode, go_to
from bfrt.scan.geometry cimport GeometryCursor, records_of, seek_records, vertices_in
from bfrt.scan.scan cimport StreamScan, next_block, record_in_block
from bfrt.streams.atomic cimport atomic_load, lock, unlock

cdef extern from *:
    """
    #define bfrt_prefetch(p) __builtin_prefetch(p)
    """
    void prefetch "bfrt_prefetch"(const void* p) noexcept nogil

cdef enum:
    SOON = 8  # delayed rays: so long before it is looked at, each is fetched

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
    const Planes* planes
    Sides sides
    Ray* rays
    void* scan             # a StreamScan
    void* deferred           # DeferredTests, or NULL where geometry is at hand
    PaddedPacket grown       # the boxes of the scan's block
    Voxels voxels          # theirs
    Near near
    uint64_t id
    int place              # of the object in the block
    Grown box
    Range region           # the object's voxels
    Shape shape
    bint loaded
    int gathered
    uint32_t rays_near[LANES]  # rays that enter the region, before they are tested together
    double reach[LANES]        # of each its nearest hit so far
    Lanes lanes
    int pending
    BoxHit meetings[LANES]
    Found* found           # all hits are wanted, or NULL: the nearest
    int64_t box_tests
    int64_t object_tests


cdef inline void fetch_ray(const Search* s, uint32_t ray) noexcept nogil:
    """Have a ray fetched from memory, which is on two lines of it, while others are looked at."""
    prefetch(&s.rays[ray].ox)
    prefetch(&s.rays[ray].t)


cdef int meet_shape(Search* s, const Shape* shape, uint64_t id) except -1 nogil:
    """Intersect an object with the pending rays, and keep the nearest hits, or all."""
    cdef int i
    cdef BoxHit* m
    cdef Ray* r
    s.object_tests += s.pending
    if s.found != NULL:
        for i in range(s.pending):
            m = &s.meetings[i]
            cross(s.found, shape, m, s.rays[m.mark].t, id)
        s.pending = 0
        return 0
    shape_meet(shape, &s.meetings[0], s.pending)
    for i in range(s.pending):
        m = &s.meetings[i]
        r = &s.rays[m.mark]
        if 0.0 <= m.t <= atomic_load(&r.t):
            lock(&r.lock)
            nearer(r, m.t, id)
            unlock(&r.lock)
    s.pending = 0
    return 0


cdef int meet_pending(Search* s, StreamScan w) except -1 nogil:
    """Intersect the object with the rays that met its box."""
    if not s.loaded:
        s.loaded = True
        shape_load(
            w.kind, record_in_block(w, s.place), vertices_in(w.geometry, s.place),
            &w.geometry.frame, &s.shape,
        )
    return meet_shape(s, &s.shape, s.id)


cdef int load(Search* s, GeometryCursor g, DeferredTests d, const Delayed* waits,
              int64_t n) except -1 nogil:
    """Fetch the geometry that the first of n delayed rays waits for, and the box around it: that
    of the scan may be quantised."""
    cdef int64_t first = waits[0].first
    cdef Box box
    if first >= d.known:
        d.known = piece_end(waits, n, g.reader.gap // g.stride)
        seek_records(g, first, d.known)
    g.objects_read += 1
    d.loaded = waits[0].id
    d.degenerate = not shape_load(
        g.kind, records_of(g, first, waits[0].count), waits[0].count, &g.frame, &d.shape
    )
    if not d.degenerate:
        shape_bounds(&d.shape, &box)
        box_grow(&box, s.planes.grow, &d.own)
    return 0


cdef inline void meet_own_box(Search* s, DeferredTests d, uint32_t ray) noexcept nogil:
    """Make a delayed ray pending if it meets its object's own box, not only the quantised."""
    cdef const Ray* r = &s.rays[ray]
    cdef BoxHit* m = &s.meetings[s.pending]
    m.line = ray_line(r)
    m.mark = ray
    if not d.degenerate and grown_span(&d.own, &m.line, &m.span):
        s.pending += m.span.near <= atomic_load(&r.t)


cdef int settle_half(Search* s, GeometryCursor g, DeferredTests d, int half) except -1 nogil:
    """Find the hits of the rays that wait in a half. An object may be the last of the other, too.
    """
    cdef const Delayed* waits = &d.halves[half, 0]
    cdef int64_t i = 0, n = d.count[half]
    while i < n:
        if waits[i].id != d.loaded:
            load(s, g, d, &waits[i], n - i)
        while i < n and waits[i].id == d.loaded and s.pending < LANES:
            fetch_ray(s, waits[min(i + SOON, n - 1)].ray)
            meet_own_box(s, d, waits[i].ray)
            i += 1
        if s.pending:
            meet_shape(s, &d.shape, d.loaded)
    return 0


cdef int put_off(Search* s, StreamScan w, DeferredTests d, uint32_t ray) except -1 nogil:
    """Have a ray that met the box wait for the object's geometry."""
    cdef int64_t first = w.boxes.first + s.place
    cdef uint32_t count = 1
    if full(d):
        ask_piece(d, w.geometry.reader)
        settle_half(s, w.geometry, d, 1 - d.half)
        turn(d)
    if w.kind == POLYGON:
        first = w.boxes.ends[s.place]
        count = w.boxes.ends[s.place + 1] - w.boxes.ends[s.place]
    delay(d, w.geometry.reader, w.geometry.stride, s.id, first, count, ray)
    return 0


cdef inline int wait_for(Search* s, StreamScan w, uint32_t ray, Vec inv, double near,
                         double far) except -1 nogil:
    """Have a ray that met the box wait for the object."""
    cdef const Ray* r = &s.rays[ray]
    cdef BoxHit* m
    if s.deferred != NULL:
        return put_off(s, w, <DeferredTests>s.deferred, ray)
    if s.pending == LANES:
        meet_pending(s, w)
    m = &s.meetings[s.pending]
    m.line.o = vec(r.ox, r.oy, r.oz)
    m.line.d = vec(r.dx, r.dy, r.dz)
    m.line.inv = inv
    m.span.near, m.span.far = near, far
    m.mark = ray
    s.pending += 1
    return 0


cdef int meet_box(Search* s, StreamScan w) except -1 nogil:
    """Test the gathered rays against the box; rays that meet it become pending."""
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
        inv = vec(l.inv[0][i], l.inv[1][i], l.inv[2][i])
        wait_for(s, w, s.rays_near[i], inv, l.near[i], l.far[i])
    return 0


cdef int keep_entering(void* context) except -1 nogil:
    """Keep the rays, of the entries that were gathered, that enter the object's region."""
    cdef Search* s = <Search*>context
    cdef Near* near = &s.near
    cdef int j
    if s.gathered + near.n > LANES:
        meet_box(s, <StreamScan>s.scan)
    for j in range(near.n):
        if entered_by(&s.region, near.at[j][0], near.at[j][1], near.at[j][2]) >> near.face[j] & 1:
            fetch_ray(s, near.ray[j])
            s.rays_near[s.gathered] = near.ray[j]
            s.gathered += 1
    near.n = 0
    return 0


cdef inline void turn_to(Search* s, StreamScan w, int place) noexcept nogil:
    """Go on to another object of the block."""
    s.place = place
    s.id = (<uint64_t>w.number << INDEX_BITS) + <uint64_t>(w.boxes.first + place)
    s.loaded = False


cdef int meet_many(Search* s, StreamScan w, VoxelRays v, int n) except -1 nogil:
    """Meet the n objects of a block, each with the rays in its voxels."""
    cdef int i
    s.near.spill = keep_entering
    for i in range(n):
        if not eight_empty(&w.boxes.eight, i):
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
    """Keep the rays that enter any of the regions, and which; return how many."""
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
    cdef unsigned int met
    cdef int i, j
    for i in range(n):
        f.count[i] = 0
    for j in range(rays):
        r = &s.rays[s.near.ray[j]]
        t = atomic_load(&r.t)
        if t < 0.0:  # a shadow ray that has met something already
            continue
        s.box_tests += ones(f.which[j])
        met = f.which[j] & eight_span(
            &s.grown, &r.ox, &r.dx, t, &f.inv[j][0], &f.near[j][0], &f.far[j][0]
        )
        while met:
            i = lowest_bit(met)
            met &= met - 1
            f.met[i][f.count[i]] = <uint8_t>j
            f.count[i] += 1


cdef int meet_few(Search* s, StreamScan w, int n) except -1 nogil:
    """Meet the n objects of a block, all with the few rays that are near any of them."""
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
                    wait_for(s, w, s.near.ray[j], inv, few.near[j][i], few.far[j][i])
            if s.pending:
                meet_pending(s, w)
    return 0


cdef int meet_block(Search* s, StreamScan w, VoxelRays v, int n) except -1 nogil:
    """Meet the n objects of a block with the rays in their voxels: half of the blocks have none."""
    cdef Box all
    cdef Range around
    block_union(w.boxes, n, &all)
    if box_empty(&all):
        return 0
    around = rough_range(s.planes, &all)
    s.near.spill = NULL
    entries_within(&around, v, &s.near)
    if s.near.n == 0:
        return 0
    decode(w.boxes, n)
    eight_grow(&w.boxes.eight, s.planes.grow, &s.grown)
    eight_voxels(s.planes, &s.sides, &w.boxes.eight, &s.voxels)
    if s.near.more:
        return meet_many(s, w, v, n)
    return meet_few(s, w, n)


@cython.final
cdef class Intersector:
    """Runs one worker's intersection loop over a group's grid and the rays in flight.

    Parameters
    ----------
    grid : Grid
    voxel_rays : VoxelRays
        Where the rays of a pass are stored.
    """

    cdef Search search
    cdef Found found
    cdef Grid grid
    cdef VoxelRays voxel_rays
    cdef DeferredTests deferred
    cdef Ray[::1] rays
    cdef Crossing[::1] crossings
    cdef object emit

    def __cinit__(self, Grid grid, VoxelRays voxel_rays):
        self.grid = grid
        self.voxel_rays = voxel_rays
        self.deferred = DeferredTests()
        self.search.planes = &grid.planes
        sides_of(self.search.planes, &self.search.sides)

    def begin(self, Ray[::1] rays, Crossing[::1] crossings=None, emit=None):
        """Begin a pass.

        Parameters
        ----------
        rays : (active,) records.RAY
            IN, OUT: t and id become those of the nearest hit. Threads share them.
        crossings : (room,) records.CROSSING, optional
            Where all hits are wanted: a buffer. The rays stay as they are.
        emit : callable, optional
            Called with how many of them there are when it is full, and at the end of a stream.
        """
        cdef Search* s = &self.search
        self.rays = rays
        self.crossings = crossings
        self.emit = emit
        s.rays = &self.rays[0]
        s.found = NULL
        s.near.context = s
        s.gathered = s.pending = 0
        s.box_tests = s.object_tests = 0
        if crossings is not None:
            self.found.crossings = &self.crossings[0]
            self.found.n, self.found.room = 0, crossings.shape[0]
            self.found.emit = <void*>emit
            s.found = &self.found

    def meet(self, StreamScan scan, const int64_t[:, ::1] ranges, const float[:, ::1] parents=None):
        """Test objects against the rays stored in their voxels.

        Parameters
        ----------
        scan : StreamScan
            Set to the first of them.
        ranges : (n, 2) int64
            First and end of runs of objects, ascending, in the scan's window.
        parents : (n, 6) float32, optional
            The box around the objects of each run, where theirs are quantised. The rays have to be
            stored by marks of those boxes.
        """
        cdef Search* s = &self.search
        cdef BoxCursor b = scan.boxes
        cdef const Box* parent = NULL
        cdef int64_t k
        cdef int n
        if b.coded and parents is None:
            raise ValueError("quantised boxes: found no boxes around them")
        s.scan = <void*>scan
        s.deferred = <void*>self.deferred if scan.deferred else NULL
        with nogil:
            for k in range(ranges.shape[0]):
                if b.coded:
                    parent = <const Box*>&parents[k, 0]
                go_to(b, ranges, k, parent)
                while b.index < ranges[k, 1]:
                    n = next_block(scan, ranges[k, 1] - b.index)
                    meet_block(s, scan, self.voxel_rays, n)

    def finish(self, StreamScan scan):
        """End a stream: test the rays that still wait for geometry, and hand over all hits."""
        cdef Search* s = &self.search
        cdef GeometryCursor g = scan.geometry
        with nogil:
            if scan.deferred:
                ask_piece(self.deferred, g.reader)
                settle_half(s, g, self.deferred, 1 - self.deferred.half)
                settle_half(s, g, self.deferred, self.deferred.half)
                end_delays(self.deferred)
            if s.found != NULL:
                hand_over(s.found)

    def tests(self):
        """Return the box tests and the object tests since `begin`."""
        return self.search.box_tests, self.search.object_tests
