"""The walks: a ray's candidate voxels, and the sentinel where its next pass begins."""

from libc.math cimport INFINITY
from libc.stdint cimport int64_t, uint8_t, uint32_t, uint64_t
from libc.string cimport memmove

from bfrt.geometry.grid cimport (
    DARK, DARK_SHIFT, DARKER, DARKER_SHIFT, NOWHERE, START, Walk, voxel_enter, walk_leave,
    walk_resume, walk_start, walk_step,
)
from bfrt.geometry.lattice cimport Lattice
from bfrt.geometry.vector cimport Line
from bfrt.image.film cimport Film, film_add
from bfrt.phases.nearest cimport ray_bad, ray_line
from bfrt.phases.outliers cimport Outliers, meet_outliers
from bfrt.phases.voxel_rays cimport entry_of
from bfrt.records cimport EYE, NO_HIT, SHADOW, Hit, Path, Queued, Ray

cdef extern from *:
    """
    /* A shadow ray ends a hair before its light, which is at t = 1. */
    #define BFRT_LIGHT (1.0 - 0x1p-30)
    """
    const double LIGHT "BFRT_LIGHT"


cdef inline bint marked(const uint8_t* marks, const Walk* w) noexcept nogil:
    return w.face == START or marks[w.voxel] >> w.face & 1


cdef inline bint walk_on(const uint8_t* marks, Walk* w) noexcept nogil:
    """On to the next voxel, or out of a cube without marks; false when the ray leaves the grid."""
    cdef uint8_t mark = marks[w.voxel]
    if mark < DARK:
        return walk_step(w)
    return walk_leave(w, DARKER_SHIFT if mark & DARKER else DARK_SHIFT)


cdef void enter(const Queued* q, Ray* r, Path* p) noexcept nogil:
    """Make a ray of a queued one."""
    r.ox, r.oy, r.oz = q.ox, q.oy, q.oz
    r.dx, r.dy, r.dz = q.dx, q.dy, q.dz
    r.t = LIGHT if q.kind == SHADOW else INFINITY
    r.id = NO_HIT
    r.voxel = NOWHERE
    r.kind = <uint8_t>q.kind
    r.face = 0
    r.lock = r.unused = 0
    p.pixel, p.sample, p.kind = q.pixel, q.sample, q.kind
    p.red, p.green, p.blue = q.red, q.green, q.blue


def admit(const Queued[::1] queued, Ray[::1] rays, Path[::1] paths, int64_t base,
          int64_t first, int64_t last, Lattice lattice, const uint8_t[::1] marks,
          Outliers outliers):
    """Walk queued rays to their first candidates; the paper's initialisation.

    Parameters
    ----------
    queued : (n,) records.QUEUED
        IN.
    rays, paths : (capacity,) records.RAY, records.PATH
        OUT from `base` on, ray for ray. Where there is no candidate, voxel is NOWHERE.
    first, last : int
        The part of `queued` to do.

    Returns
    -------
    steps, box_tests, object_tests, bad : int
        Counts; bad rays are NaN, infinite or without direction.
    """
    cdef int64_t i, steps = 0, box_tests = 0, object_tests = 0, bad = 0
    cdef Ray* r
    cdef Line line
    cdef Walk w
    with nogil:
        for i in range(first, last):
            r = &rays[base + i]
            enter(&queued[i], r, &paths[base + i])
            if ray_bad(r):
                bad += 1
                continue
            line = ray_line(r)
            meet_outliers(outliers, r, &line, lattice.grow, &box_tests, &object_tests)
            if not walk_start(&w, &lattice.grid, &line):
                continue
            while w.enter <= r.t:
                steps += 1
                if marked(&marks[0], &w):
                    r.voxel = w.voxel
                    r.face = <uint8_t>w.face
                    break
                if not walk_on(&marks[0], &w):
                    break
    return steps, box_tests, object_tests, bad


def collect(Ray[::1] rays, int64_t first, int64_t last, Lattice lattice,
            const uint8_t[::1] marks, int64_t quota, uint64_t[::1] slots):
    """Find the candidates of this pass, and the sentinel.

    Parameters
    ----------
    rays : (n,) records.RAY
        IN, OUT. (voxel, face) is the first candidate of this pass; afterwards that of the next,
        or voxel is NOWHERE.
    quota : int
        Candidates a ray at the most.
    slots : (capacity,) uint64
        OUT, from first * quota on.

    Returns
    -------
    n, steps : int
        Candidates found; voxels stepped to.
    """
    cdef int64_t i, found, n = first * quota, steps = 0
    cdef Ray* r
    cdef Line line
    cdef Walk w
    with nogil:
        for i in range(first, last):
            r = &rays[i]
            line = ray_line(r)
            walk_resume(&w, &lattice.grid, &line, r.voxel, r.face)
            slots[n] = entry_of(w.voxel, <uint32_t>i, w.face)
            n += 1
            found = 1
            r.voxel = NOWHERE
            while walk_on(&marks[0], &w) and w.enter <= r.t:
                steps += 1
                if not marked(&marks[0], &w):
                    continue
                if found == quota:
                    r.voxel = w.voxel
                    r.face = <uint8_t>w.face
                    break
                slots[n] = entry_of(w.voxel, <uint32_t>i, w.face)
                n += 1
                found += 1
    return n - first * quota, steps


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
    h.pixel, h.sample, h.kind = p.pixel, p.sample, p.kind
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
           Film film, const double[::1] background, Hit[::1] hits):
    """Let complete rays of a part go, and close its ranks.

    Parameters
    ----------
    rays, paths : (capacity,)
        IN, OUT: those of [first, last) that stay are at its front.
    hits : (last - first or more,) records.HIT
        OUT: intersections to be shaded.

    Returns
    -------
    kept, n, eye_hits : int
        Rays that stay; intersections written; those of eye rays.
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
            elif r.id == NO_HIT:
                finish_miss(r, &paths[i], film, &background[0])
            elif r.kind != SHADOW:
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
