"""Rays that are traced elsewhere: as they set out, and as they come back."""

from libc.math cimport INFINITY
from libc.stdint cimport int64_t

from bfrt.image.film cimport Film
from bfrt.phases.nearest cimport ray_bad
from bfrt.phases.ray_records cimport LIGHT, finish_hit, finish_miss, take_over
from bfrt.records cimport EYE, NO_HIT, SHADOW, Hit, Path, Queued, Ray


def set_out(const Queued[::1] queued, Hit[::1] rays):
    """Make queued rays into such as have met nothing yet.

    Parameters
    ----------
    queued : (n,) records.QUEUED
        IN.
    rays : (n,) records.HIT
        OUT. Each with the t where it ends; -1 for one that is NaN, infinite or without direction.

    Returns
    -------
    int
        The number of these.
    """
    cdef const Queued* q
    cdef Path path
    cdef Ray r
    cdef int64_t i, bad = 0
    with nogil:
        for i in range(rays.shape[0]):
            q = &queued[i]
            take_over(&r, &path, &q.ox, &q.pixel)
            r.id, r.t = NO_HIT, LIGHT if q.kind == SHADOW else INFINITY
            if ray_bad(&r):
                r.t = -1.0
                bad += 1
            finish_hit(&r, &path, &rays[i])
    return bad


def settle(Hit[::1] rays, Film film not None, const double[::1] background):
    """Bring the light of rays that met nothing to a film, and keep the hits.

    Parameters
    ----------
    rays : (n,) records.HIT
        IN, OUT. Complete rays; then hits that are to be shaded, at the front. Shadow rays that
        have met something end.
    film : Film
    background : (3,) float64

    Returns
    -------
    hits, eye_hits : int
        Hits; of them those of eye rays.
    """
    cdef Hit* h
    cdef Path path
    cdef Ray r
    cdef int64_t i, n = 0, eye_hits = 0
    with nogil:
        for i in range(rays.shape[0]):
            h = &rays[i]
            if h.id == NO_HIT:
                take_over(&r, &path, &h.ox, &h.pixel)
                r.kind = path.kind
                finish_miss(&r, &path, film, &background[0])
            elif h.kind != SHADOW:
                if n != i:
                    rays[n] = h[0]
                n += 1
                eye_hits += h.kind == EYE
    return n, eye_hits
