"""The slow twin's loop: every object of a cursor against every ray."""

from libc.math cimport NAN
from libc.stdint cimport int64_t, uint32_t, uint64_t

from bfrt.geometry.box cimport Box, box_span
from bfrt.geometry.far cimport Bounds, advance_far, bounds_of, scale_extreme
from bfrt.geometry.shape cimport (
    BoxHit, Shape, shape_bounds, shape_crossings, shape_load, shape_meet,
)
from bfrt.geometry.vector cimport Line, Vec, line, vec
from bfrt.phases.nearest cimport ray_bad
from bfrt.records cimport Ray
from bfrt.scan.geometry cimport GeometryCursor, next_records, vertices_in

cdef enum:
    TOGETHER = 64     # rays that meet a box before the kernel is called

cpdef enum:
    LINE_DOUBLES = 9

cdef struct Nearest:
    double* t
    uint64_t* id


cdef inline void keep_nearest(const BoxHit* met, int n, uint64_t id,
                              Nearest* nearest) noexcept nogil:
    """Take each hit whose (t, id) is less than its ray's."""
    cdef int i
    cdef uint32_t ray
    cdef double t
    for i in range(n):
        t = met[i].t
        ray = met[i].mark
        if t < 0.0:
            continue
        if t < nearest.t[ray] or (t == nearest.t[ray] and id < nearest.id[ray]):
            nearest.t[ray] = t
            nearest.id[ray] = id


def scale_directions(double[:, ::1] directions, int[::1] powers):
    """Divide extreme directions by powers of two.

    Parameters
    ----------
    directions : (n, 3) float64
        IN, OUT.
    powers : (n,) int32
        OUT. 0 for those that stay as they are.
    """
    cdef Vec d
    cdef int64_t i
    with nogil:
        for i in range(directions.shape[0]):
            d = vec(directions[i, 0], directions[i, 1], directions[i, 2])
            powers[i] = scale_extreme(&d)
            directions[i, 0], directions[i, 1], directions[i, 2] = d.x, d.y, d.z


def bring_near(double[:, ::1] origins, const double[:, ::1] directions,
               const double[:, ::1] bounds, double[::1] moved):
    """Bring rays that start far away nearer (exactness rule 6).

    Parameters
    ----------
    origins : (n, 3) float64
        IN, OUT. NaN where the ray is none: not finite, or without direction.
    directions : (n, 3) float64
        IN.
    bounds : (2, 3) float64
        IN. The scene's.
    moved : (n,) float64
        OUT. The t by which each has come nearer.
    """
    cdef Bounds b = bounds_of(bounds)
    cdef Line ray
    cdef Ray r
    cdef int64_t i
    with nogil:
        for i in range(origins.shape[0]):
            r.ox, r.oy, r.oz = origins[i, 0], origins[i, 1], origins[i, 2]
            r.dx, r.dy, r.dz = directions[i, 0], directions[i, 1], directions[i, 2]
            moved[i] = 0.0
            if ray_bad(&r):
                origins[i, 0] = origins[i, 1] = origins[i, 2] = NAN
                continue
            ray = line(vec(r.ox, r.oy, r.oz), vec(r.dx, r.dy, r.dz))
            moved[i] = advance_far(&ray, &b)
            origins[i, 0], origins[i, 1], origins[i, 2] = ray.o.x, ray.o.y, ray.o.z


def lines(const double[:, ::1] origins, const double[:, ::1] directions, double[:, ::1] out):
    """Make lines of rays.

    Parameters
    ----------
    origins, directions : (n, 3) float64
        IN.
    out : (n, 9) float64
        OUT. What `meet` takes.
    """
    cdef int64_t i
    if LINE_DOUBLES * sizeof(double) != sizeof(Line) or out.shape[1] != LINE_DOUBLES:
        raise TypeError(f"lines: found {out.shape[1]} numbers, expected {sizeof(Line) // 8}")
    with nogil:
        for i in range(origins.shape[0]):
            (<Line*>&out[i, 0])[0] = line(
                vec(origins[i, 0], origins[i, 1], origins[i, 2]),
                vec(directions[i, 0], directions[i, 1], directions[i, 2]),
            )


def meet(GeometryCursor cursor, const uint64_t[::1] objects, double padding,
         const double[:, ::1] rays, double[::1] t, uint64_t[::1] ids):
    """Meet the next objects of a cursor, which have these ids, with every ray.

    Nothing is culled by the hit so far. The box is that of the geometry, not the one on disk.

    Parameters
    ----------
    padding : float
        d, by which boxes are padded (docs/algorithm.rst, Exactness).
    rays : (m, 9) float64
        IN. From `lines`; those with a NaN for an origin are passed over.
    t, ids : (m,) float64, uint64
        IN, OUT: the least (t, id) of each.
    """
    cdef BoxHit met[TOGETHER]
    cdef const Line* ray
    cdef Nearest nearest
    cdef Shape shape
    cdef Box box
    cdef uint64_t id
    cdef int64_t i, k, count = rays.shape[0]
    cdef int pending
    if count == 0:
        return
    nearest.t = &t[0]
    nearest.id = &ids[0]
    with nogil:
        for i in range(objects.shape[0]):
            id = objects[i]
            next_records(cursor, 1)
            if not shape_load(
                cursor.kind, cursor.block, vertices_in(cursor, 0), &cursor.frame, &shape
            ):
                continue
            shape_bounds(&shape, &box)
            pending = 0
            for k in range(count):
                ray = <const Line*>&rays[k, 0]
                if ray.o.x != ray.o.x or not box_span(&box, padding, ray, &met[pending].span):
                    continue
                met[pending].line = ray[0]
                met[pending].mark = <uint32_t>k
                pending += 1
                if pending == TOGETHER:
                    shape_meet(&shape, &met[0], pending)
                    keep_nearest(&met[0], pending, id, &nearest)
                    pending = 0
            shape_meet(&shape, &met[0], pending)
            keep_nearest(&met[0], pending, id, &nearest)


def cross(GeometryCursor cursor, const uint64_t[::1] objects, double padding,
          const double[:, ::1] rays, list found):
    """Find all hits of the next objects of a cursor, which have these ids, with every ray.

    Parameters
    ----------
    padding, rays
        As for `meet`.
    found : list of (int, float, int)
        OUT. Which ray, t, id.
    """
    cdef const Line* ray
    cdef BoxHit m
    cdef Shape shape
    cdef Box box
    cdef double t[2]
    cdef uint64_t id
    cdef int64_t j, k
    cdef int i
    for j in range(objects.shape[0]):
        id = objects[j]
        next_records(cursor, 1)
        if not shape_load(cursor.kind, cursor.block, vertices_in(cursor, 0), &cursor.frame, &shape):
            continue
        shape_bounds(&shape, &box)
        for k in range(rays.shape[0]):
            ray = <const Line*>&rays[k, 0]
            if ray.o.x != ray.o.x or not box_span(&box, padding, ray, &m.span):
                continue
            for i in range(shape_crossings(&shape, ray, &m.span, &t[0])):
                found.append((k, t[i], id))
