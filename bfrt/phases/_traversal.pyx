"""The walks: a ray's candidate voxels, and the sentinel where its next pass begins."""

from libc.math cimport INFINITY
from libc.stdint cimport int32_t, int64_t, uint8_t, uint16_t, uint32_t, uint64_t
from libc.string cimport memcpy, memmove

from bfrt.geometry.grid cimport (
    BRICK, BRICK_BYTES, BRICK_SHIFT, CUBE_SHIFT, DARK, DARK_SHIFT, EMPTY_CUBE, NOWHERE, START, Grid,
    Walk, voxel_enter, walk_leave, walk_resume, walk_start, walk_step,
)
from bfrt.geometry.lattice cimport Lattice
from bfrt.geometry.vector cimport Line
from bfrt.image.film cimport Film, film_add
from bfrt.phases.nearest cimport ray_bad, ray_line
from bfrt.phases.outliers cimport Outliers, meet_outliers
from bfrt.phases.voxel_rays cimport VoxelRays, entry_of, voxel_of
from bfrt.records cimport EYE, NO_HIT, SHADOW, Hit, Path, Queued, Ray
from bfrt.streams.atomic cimport atomic_fetch_add

cdef extern from *:
    """
    /* A shadow ray ends a hair before its light, which is at t = 1. */
    #define BFRT_LIGHT (1.0 - 0x1p-30)
    """
    const double LIGHT "BFRT_LIGHT"

# What is known of the voxel where a ray's walk is.
cdef enum:
    CANDIDATE = 0  # it is a candidate: the next that is taken
    UNSEEN = 1     # its marks have not been looked at

cdef enum:
    NO_SLAB = 1 << 30  # farther than any

cdef enum:
    GATHERED = 128  # candidates that a thread puts into memory together

# The slab that is in memory, and where the bricks of all are.
cdef struct Slab:
    int number
    const int32_t* table   # where each brick is, of the whole grid
    int64_t stride[3]      # of a brick in the table, an axis
    int shift[3]           # of a voxel in its brick, an axis
    int axis
    const int32_t* slab_of  # the slab of each layer of bricks
    const uint8_t* bricks
    int64_t first_brick    # the number of the first of them

# Candidates on their way from one thread into memory that all share.
cdef struct Outgoing:
    uint64_t entries[GATHERED]
    int n
    uint64_t* slots
    int64_t* used


cdef inline void flush(Outgoing* out) noexcept nogil:
    cdef int64_t at = atomic_fetch_add(out.used, out.n)
    memcpy(&out.slots[at], &out.entries[0], out.n * sizeof(uint64_t))
    out.n = 0


cdef inline void put(Outgoing* out, uint64_t entry) noexcept nogil:
    out.entries[out.n] = entry
    out.n += 1
    if out.n == GATHERED:
        flush(out)


cdef inline int32_t brick_at(const Slab* s, const int* at) noexcept nogil:
    """Where the brick of a voxel is, or EMPTY_BRICK, or EMPTY_CUBE."""
    return s.table[
        (at[0] >> BRICK_SHIFT) * s.stride[0] + (at[1] >> BRICK_SHIFT) * s.stride[1]
        + (at[2] >> BRICK_SHIFT) * s.stride[2]
    ]


cdef inline uint8_t mark_at(const Slab* s, int64_t brick, const int* at) noexcept nogil:
    """The marks of a voxel of a brick."""
    return s.bricks[
        (brick - s.first_brick) * BRICK_BYTES + ((at[0] & (BRICK - 1)) << s.shift[0])
        + ((at[1] & (BRICK - 1)) << s.shift[1]) + ((at[2] & (BRICK - 1)) << s.shift[2])
    ]


cdef inline bint walk_on(int32_t brick, uint8_t mark, Walk* w) noexcept nogil:
    """On to the next voxel, or out of a cube without marks; false when the ray leaves the grid."""
    if brick >= 0:
        return walk_leave(w, DARK_SHIFT) if mark & DARK else walk_step(w)
    return walk_leave(w, CUBE_SHIFT if brick == EMPTY_CUBE else BRICK_SHIFT)


cdef inline void take_over(Ray* r, Path* p, const double* line,
                           const uint32_t* path) noexcept nogil:
    """Copy a ray's line, and what it is for: the fields that all records of a ray have alike."""
    memcpy(&r.ox, line, 6 * sizeof(double))
    memcpy(p, path, sizeof(Path))


cdef inline void begin(Ray* r, double t, uint64_t id, uint16_t kind) noexcept nogil:
    """A ray that has not yet met the grid."""
    r.t, r.id = t, id
    r.voxel = NOWHERE
    r.kind = <uint8_t>kind
    r.face = 0
    r.lock = 0
    r.state = UNSEEN


cdef inline void come_in(Ray* r, Lattice lattice, Outliers outliers, int64_t* box_tests,
                         int64_t* object_tests) noexcept nogil:
    """Test a ray against the outliers, and bring it to where it first meets the grid."""
    cdef Line line = ray_line(r)
    cdef Walk w
    if outliers is not None:
        meet_outliers(outliers, r, &line, lattice.grow, box_tests, object_tests)
    if walk_start(&w, &lattice.grid, &line) and w.enter <= r.t:
        r.voxel = w.voxel
        r.face = <uint8_t>w.face


def admit(const Queued[::1] queued, Ray[::1] rays, Path[::1] paths, int64_t base,
          int64_t first, int64_t last, Lattice lattice, Outliers outliers):
    """Bring queued rays to where they first meet the grid.

    Parameters
    ----------
    queued : (n,) records.QUEUED
        IN.
    rays, paths : (capacity,) records.RAY, records.PATH
        OUT from `base` on, ray for ray. Where a ray does not meet the grid, voxel is NOWHERE.
    first, last : int
        The part of `queued` to do.
    outliers : Outliers or None
        None where all hits are wanted, which `cross_outliers` finds.

    Returns
    -------
    box_tests, object_tests, bad : int
        Counts; bad rays are NaN, infinite or without direction.
    """
    cdef int64_t i, box_tests = 0, object_tests = 0, bad = 0
    cdef const Queued* q
    cdef Ray* r
    with nogil:
        for i in range(first, last):
            q, r = &queued[i], &rays[base + i]
            take_over(r, &paths[base + i], &q.ox, &q.pixel)
            begin(r, LIGHT if q.kind == SHADOW else INFINITY, NO_HIT, q.kind)
            if ray_bad(r):
                bad += 1
            else:
                come_in(r, lattice, outliers, &box_tests, &object_tests)
    return box_tests, object_tests, bad


def admit_again(const Hit[::1] partial, Ray[::1] rays, Path[::1] paths, int64_t base,
                int64_t first, int64_t last, Lattice lattice, Outliers outliers):
    """Bring rays that have been through other groups to where they first meet this one's grid.

    Parameters
    ----------
    partial : (n,) records.HIT
        IN. Rays, with the nearest hit so far: t is where a ray ends where it has none.
    rays, paths, base, first, last
        As for `admit`, and what is returned.
    """
    cdef int64_t i, box_tests = 0, object_tests = 0
    cdef const Hit* h
    cdef Ray* r
    with nogil:
        for i in range(first, last):
            h, r = &partial[i], &rays[base + i]
            take_over(r, &paths[base + i], &h.ox, &h.pixel)
            begin(r, h.t, h.id, h.kind)
            if not ray_bad(r):  # which has been counted
                come_in(r, lattice, outliers, &box_tests, &object_tests)
    return box_tests, object_tests, 0


cdef inline int slab_of(const Grid* g, const Ray* r, const int32_t* slabs) noexcept nogil:
    return slabs[r.voxel // <uint32_t>g.stride[g.order[2]] >> BRICK_SHIFT]


cdef inline bint descends(const Grid* g, const Ray* r) noexcept nogil:
    """Whether a ray goes through the slabs from the last to the first."""
    return (&r.dx)[g.order[2]] < 0.0


cdef inline int part_of(const Grid* g, const Ray* r, const int32_t* layers,
                        int slabs) noexcept nogil:
    """Where a ray is in the order of its way through the slabs: up first, then down."""
    cdef int slab = slab_of(g, r, layers)
    return 2 * slabs - 1 - slab if descends(g, r) else slab


def arrange(const Ray[::1] rays, int64_t first, Lattice lattice, const int32_t[::1] slab_of_layer,
            int64_t[::1] starts, uint32_t[::1] order):
    """Put rays into the slabs where their walks are (the paper's figure 4).

    Parameters
    ----------
    rays : (n,) records.RAY
        IN.
    first : int
        The rays before it are left out.
    slab_of_layer : (layers of bricks,) int32
        IN.
    starts : (2 slabs + 1,) int64
        OUT. Where each part of `order` begins: rays that ascend, slab by slab, then those that
        descend, from the last slab to the first.
    order : (n,) uint32
        OUT. The rays' numbers.
    """
    cdef int64_t i, total
    cdef int slabs = <int>(starts.shape[0] // 2), part
    cdef const int32_t* layers = &slab_of_layer[0]
    with nogil:
        starts[:] = 0
        for i in range(first, rays.shape[0]):
            if rays[i].voxel != NOWHERE:
                starts[part_of(&lattice.grid, &rays[i], layers, slabs) + 1] += 1
        for part in range(2 * slabs):
            starts[part + 1] += starts[part]
        total = starts[2 * slabs]
        for i in range(rays.shape[0] - 1, first - 1, -1):
            if rays[i].voxel != NOWHERE:
                part = part_of(&lattice.grid, &rays[i], layers, slabs)
                starts[part + 1] -= 1
                order[starts[part + 1]] = <uint32_t>i
        # Each start has sunk to the one before it.
        for part in range(2 * slabs):
            starts[part] = starts[part + 1]
        starts[2 * slabs] = total


cdef int64_t walk_ray(const Slab* s, Walk* w, Ray* r, uint32_t ray, uint32_t* left, VoxelRays v,
                      Outgoing* out) noexcept nogil:
    """Walk through the slab, until the sentinel is found; returns the voxels stepped to.

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
            if left[0] == 0:
                r.voxel, r.face = w.voxel, <uint8_t>w.face
                return steps
            left[0] -= 1
            put(out, entry_of(voxel_of(v, &w.at[0]), ray, w.face))
            candidate = False
        if not walk_on(brick, mark, w) or w.enter > r.t:
            r.voxel = NOWHERE
            return steps


def walk(Ray[::1] rays, uint32_t[::1] order, int64_t first, int64_t last, Lattice lattice, int slab,
         const uint8_t[:, ::1] bricks, int64_t first_brick, const int32_t[:, :, ::1] table,
         const int32_t[::1] slab_of_layer, uint32_t[::1] left, VoxelRays voxel_rays,
         uint64_t[::1] slots, int64_t[::1] used):
    """Walk rays through one slab: the candidates of this pass, and the sentinel.

    Parameters
    ----------
    rays : (n,) records.RAY
        IN, OUT. (voxel, face) is where a ray is; afterwards the first candidate of the next pass,
        or where it comes into another slab, or voxel is NOWHERE.
    order : (n,) uint32
        IN, OUT. Which rays, in [first, last); afterwards, from first on, those that go on to
        another slab.
    slab : int
        The slab's number.
    bricks : (n, 512) uint8
        IN. Its bricks, of which the first has the number `first_brick`.
    table : (layers, rows, row) int32
        IN. Where each brick is.
    slab_of_layer : (layers,) int32
        IN.
    left : (n,) uint32
        IN, OUT. Candidates that each ray may still take in this pass.
    slots : (capacity,) uint64
        OUT, from used[0] on: candidates.
    used : (1,) int64
        IN, OUT. Threads share it.

    Returns
    -------
    leaving, nearest, steps : int
        Rays that go on to another slab; how many slabs on the nearest of those is; voxels stepped
        to.
    """
    cdef const Grid* g = &lattice.grid
    cdef Slab s
    cdef Outgoing out
    cdef Walk w
    cdef Line line
    cdef Ray* r
    cdef int64_t i, stride = 1, leaving = first, steps = 0
    cdef int k, nearest = NO_SLAB
    cdef uint32_t ray
    s.number, s.axis = slab, g.order[2]
    s.table, s.slab_of = &table[0, 0, 0], &slab_of_layer[0]
    s.bricks, s.first_brick = &bricks[0, 0], first_brick
    for k in range(3):
        s.stride[g.order[k]] = stride
        s.shift[g.order[k]] = k * BRICK_SHIFT
        stride *= table.shape[2 - k]
    out.n, out.slots, out.used = 0, &slots[0], &used[0]
    with nogil:
        for i in range(first, last):
            ray = order[i]
            r = &rays[ray]
            if r.voxel == NOWHERE:
                continue
            if slab_of(g, r, s.slab_of) == slab:
                line = ray_line(r)
                walk_resume(&w, g, &line, r.voxel, r.face)
                steps += walk_ray(&s, &w, r, ray, &left[ray], voxel_rays, &out)
                if r.voxel == NOWHERE or slab_of(g, r, s.slab_of) == slab:
                    continue
            order[leaving] = ray
            leaving += 1
            nearest = min(nearest, abs(slab_of(g, r, s.slab_of) - slab))
        flush(&out)
    return leaving - first, nearest, steps


def close_up(uint32_t[::1] order, const int64_t[::1] firsts, const int64_t[::1] counts,
             int64_t end):
    """Move the parts (firsts, counts), ascending, together so that they end at `end`; returns
    where they begin."""
    cdef int64_t i
    with nogil:
        for i in range(firsts.shape[0] - 1, -1, -1):
            end -= counts[i]
            memmove(&order[end], &order[firsts[i]], counts[i] * sizeof(uint32_t))
    return end


cdef inline bint complete(const Ray* r, Lattice lattice) noexcept nogil:
    """No sentinel, or a hit that is nearer: strictly, so that objects that tie are all met."""
    cdef Line line
    if r.voxel == NOWHERE:
        return True
    if r.t == INFINITY:
        return False
    line = ray_line(r)
    return r.t < voxel_enter(&lattice.grid, &line, r.voxel, r.face)


cdef inline void finish_hit(const Ray* r, const Path* p, Hit* h) noexcept nogil:
    h.ox, h.oy, h.oz = r.ox, r.oy, r.oz
    h.dx, h.dy, h.dz = r.dx, r.dy, r.dz
    h.t, h.id = r.t, r.id
    h.pixel, h.sample, h.kind, h.power = p.pixel, p.sample, p.kind, p.power
    h.red, h.green, h.blue = p.red, p.green, p.blue


cdef inline void finish_miss(const Ray* r, const Path* p, Film film,
                             const double* background) noexcept nogil:
    """A shadow ray that met nothing brings its light; any other sees the background."""
    if r.kind == SHADOW:
        film_add(film, p.pixel, p.red, p.green, p.blue, 0.0)
    else:
        film_add(
            film, p.pixel, p.red * background[0], p.green * background[1],
            p.blue * background[2], 0.0,
        )


def settle(Ray[::1] rays, Path[::1] paths, int64_t first, int64_t last, Lattice lattice,
           Film film, const double[::1] background, Hit[::1] hits, bint shaded=True):
    """Let complete rays of a part go, and close its ranks.

    Parameters
    ----------
    rays, paths : (capacity,)
        IN, OUT: those of [first, last) that stay are at its front.
    hits : (last - first or more,) records.HIT
        OUT: intersections that are to be shaded; where they are not, all rays, with the nearest
        hit so far. Shadow rays that have met something end anyway.

    Returns
    -------
    kept, n, eye_hits : int
        Rays that stay; those written; of them eye rays.
    """
    cdef int64_t i, kept = first, n = 0, eye_hits = 0
    cdef Ray* r
    with nogil:
        for i in range(first, last):
            r = &rays[i]
            if not complete(r, lattice):
                if kept != i:
                    rays[kept] = r[0]
                    paths[kept] = paths[i]
                kept += 1
            elif shaded and r.id == NO_HIT:
                finish_miss(r, &paths[i], film, &background[0])
            elif r.kind != SHADOW or r.id == NO_HIT:
                finish_hit(r, &paths[i], &hits[n])
                n += 1
                eye_hits += r.kind == EYE
    return kept - first, n, eye_hits


def close_ranks(Ray[::1] rays, Path[::1] paths, int64_t base, const int64_t[::1] firsts,
                const int64_t[::1] counts):
    """Move the parts (firsts, counts), ascending, together to `base`; returns where they end."""
    cdef int64_t i, end = base
    with nogil:
        for i in range(firsts.shape[0]):
            memmove(&rays[end], &rays[firsts[i]], counts[i] * sizeof(Ray))
            memmove(&paths[end], &paths[firsts[i]], counts[i] * sizeof(Path))
            end += counts[i]
    return end
