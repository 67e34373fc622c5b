"""The intersection loop: each object against the rays stored in its voxels.

Objects are looked at eight at a time. Where few rays wait in the voxels of the eight, these are
gathered once and each is tested against the eight boxes; where many do, each object looks for its
own, and its box is tested against those in lanes. Rays that meet a box are tested against the
object at once where its geometry is at hand; otherwise they wait for it (settle.pxd).
"""

cimport cython
from libc.stdint cimport int64_t, uint8_t, uint32_t, uint64_t

from bfrt.bits cimport lowest_bit, ones
from bfrt.geometry.box cimport Box, PaddedBox, box_empty
from bfrt.geometry.lanes cimport LANES, Lanes, padded_lanes
from bfrt.geometry.packet cimport BOXES, PaddedPacket, eight_empty, eight_pad, eight_span, padded_at
from bfrt.geometry.shape cimport BoxHit, Shape, shape_load
from bfrt.geometry.vector cimport Vec, vec
from bfrt.grid.grid cimport Grid
from bfrt.grid.nearby cimport Near, entries_within
from bfrt.grid.planes cimport Planes, Range, entered_by, rough_range
from bfrt.grid.regions cimport PacketPlanes, Voxels, eight_voxels, entered, packet_planes, range_at
from bfrt.grid.voxel_rays cimport VoxelRays
from bfrt.phases.crossings cimport CrossingBuffer, hand_over
from bfrt.phases.pending cimport Pending, prefetch_ray, test_pending
from bfrt.phases.settle cimport defer_test, settle_all
from bfrt.records cimport Ray
from bfrt.scan.boxes cimport BoxCursor, block_union, decode, go_to
from bfrt.scan.deferred cimport DeferredTests
from bfrt.scan.geometry cimport vertices_in
from bfrt.scan.given_order cimport GivenOrder
from bfrt.scan.scan cimport StreamScan, next_block, object_id, record_in_block
from bfrt.streams.atomic cimport atomic_load

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
    PacketPlanes packet_planes
    void* scan             # a StreamScan
    void* deferred         # DeferredTests, or NULL where geometry is at hand
    PaddedPacket padded    # the boxes of the scan's block
    Voxels voxels          # theirs
    Near near
    uint64_t id
    int place              # of the object in the block
    PaddedBox box
    Range region           # the object's voxels
    Shape shape
    bint loaded
    int gathered
    uint32_t entering[LANES]  # rays that enter the region, before they are tested together
    double reach[LANES]       # of each its nearest hit so far
    Lanes lanes
    Pending pending
    int64_t box_tests


cdef int meet_pending(Search* s, StreamScan w) except -1 nogil:
    """Intersect the object with the rays that met its box."""
    if not s.loaded:
        s.loaded = True
        shape_load(
            w.kind, record_in_block(w, s.place), vertices_in(w.geometry, s.place),
            &w.geometry.frame, &s.shape,
        )
    return test_pending(&s.pending, &s.shape, s.id)


cdef inline int wait_for(Search* s, StreamScan w, uint32_t ray, Vec inv, double near,
                         double far) except -1 nogil:
    """Have a ray that met the box wait for the object."""
    cdef Pending* p = &s.pending
    cdef const Ray* r = &p.rays[ray]
    cdef BoxHit* m
    if s.deferred != NULL:
        return defer_test(p, w, <DeferredTests>s.deferred, s.place, ray)
    if p.n == LANES:
        meet_pending(s, w)
    m = &p.meetings[p.n]
    m.line.o = vec(r.ox, r.oy, r.oz)
    m.line.d = vec(r.dx, r.dy, r.dz)
    m.line.inv = inv
    m.span.near, m.span.far = near, far
    m.mark = ray
    p.n += 1
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
        ray = s.entering[i]
        r = &s.pending.rays[ray]
        t = atomic_load(&r.t)
        if t < 0.0:  # a shadow ray that has met something already
            continue
        s.entering[n] = ray
        s.reach[n] = t
        l.o[0][n], l.o[1][n], l.o[2][n] = r.ox, r.oy, r.oz
        l.d[0][n], l.d[1][n], l.d[2][n] = r.dx, r.dy, r.dz
        n += 1
    s.gathered = 0
    s.box_tests += n
    padded_lanes(l, n, &s.box)
    for i in range(n):
        # What is nearer is culled by >, never by >=: a tie goes to the smaller id.
        if not l.near[i] <= l.far[i] or l.near[i] > s.reach[i]:
            continue
        inv = vec(l.inv[0][i], l.inv[1][i], l.inv[2][i])
        wait_for(s, w, s.entering[i], inv, l.near[i], l.far[i])
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
            prefetch_ray(&s.pending.rays[near.ray[j]])
            s.entering[s.gathered] = near.ray[j]
            s.gathered += 1
    near.n = 0
    return 0


cdef inline void turn_to(Search* s, StreamScan w, int place) noexcept nogil:
    """Go on to another object of the block."""
    s.place = place
    s.id = object_id(w, place)
    s.loaded = False


cdef int meet_many(Search* s, StreamScan w, VoxelRays v, int n) except -1 nogil:
    """Meet the n objects of a block, each with the rays in its voxels."""
    cdef int i
    s.near.spill = keep_entering
    for i in range(n):
        if not eight_empty(&w.boxes.eight, i):
            turn_to(s, w, i)
            padded_at(&s.padded, i, &s.box)
            s.region = range_at(&s.voxels, i)
            entries_within(v, &s.region, &s.near)
            keep_entering(s)
            meet_box(s, w)
            if s.pending.n:
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
        r = &s.pending.rays[s.near.ray[j]]
        t = atomic_load(&r.t)
        if t < 0.0:  # a shadow ray that has met something already
            continue
        s.box_tests += ones(f.which[j])
        met = f.which[j] & eight_span(
            &s.padded, &r.ox, &r.dx, t, &f.inv[j][0], &f.near[j][0], &f.far[j][0]
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
        prefetch_ray(&s.pending.rays[s.near.ray[j]])
    test_boxes(s, n, rays, &few)
    for i in range(n):
        if few.count[i]:
            turn_to(s, w, i)
            for k in range(few.count[i]):
                j = few.met[i][k]
                # Unless what it met since is nearer.
                if not few.near[j][i] > atomic_load(&s.pending.rays[s.near.ray[j]].t):
                    inv = vec(few.inv[j][0], few.inv[j][1], few.inv[j][2])
                    wait_for(s, w, s.near.ray[j], inv, few.near[j][i], few.far[j][i])
            if s.pending.n:
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
    entries_within(v, &around, &s.near)
    if s.near.n == 0:
        return 0
    decode(w.boxes, n)
    eight_pad(&w.boxes.eight, s.planes.padding, &s.padded)
    eight_voxels(s.planes, &s.packet_planes, &w.boxes.eight, &s.voxels)
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
    order : GivenOrder
        Which of two objects comes first.
    """

    cdef Search search
    cdef GivenOrder order
    cdef Grid grid
    cdef VoxelRays voxel_rays
    cdef DeferredTests deferred
    cdef Ray[::1] rays
    cdef CrossingBuffer crossings

    def __cinit__(self, Grid grid, VoxelRays voxel_rays, GivenOrder order not None):
        self.grid = grid
        self.order = order
        self.search.pending.order = <void*>order
        self.voxel_rays = voxel_rays
        self.deferred = DeferredTests(grid.padding)
        self.search.planes = &grid.planes
        packet_planes(self.search.planes, &self.search.packet_planes)

    def begin(self, Ray[::1] rays, CrossingBuffer crossings=None):
        """Begin a pass.

        Parameters
        ----------
        rays : (active,) records.RAY
            IN, OUT: t and id become those of the nearest hit. Threads share them.
        crossings : CrossingBuffer, optional
            Where all hits are wanted. The rays stay as they are.
        """
        cdef Search* s = &self.search
        self.rays = rays
        self.crossings = crossings
        s.pending.rays = &self.rays[0]
        s.pending.crossings = NULL if crossings is None else <void*>crossings
        s.near.context = s
        s.gathered = s.pending.n = 0
        s.box_tests = s.pending.tests = 0

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
        with nogil:
            if scan.deferred:
                settle_all(&self.search.pending, scan.geometry, self.deferred)
            if self.crossings is not None:
                hand_over(self.crossings)

    def tests(self):
        """Return the box tests and the object tests since `begin`."""
        return self.search.box_tests, self.search.pending.tests
