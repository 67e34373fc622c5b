"""Rays in flight become records, and records rays in flight: on the way in, and on the way out."""

from libc.stdint cimport uint32_t
from libc.string cimport memcpy

from bfrt.image.film cimport Film, film_add
from bfrt.records cimport SHADOW, Hit, Path, Ray

cdef extern from *:
    """
    /* A shadow ray ends a hair before its light, which is at t = 1. */
    #define BFRT_LIGHT (1.0 - 0x1p-30)
    """
    const double LIGHT "BFRT_LIGHT"


cdef inline void take_over(Ray* r, Path* p, const double* line,
                           const uint32_t* path) noexcept nogil:
    """Copy a ray's line and purpose: the fields that all records of a ray have in common."""
    memcpy(&r.ox, line, 6 * sizeof(double))
    memcpy(p, path, sizeof(Path))


cdef inline void finish_hit(const Ray* r, const Path* p, Hit* h) noexcept nogil:
    h.ox, h.oy, h.oz = r.ox, r.oy, r.oz
    h.dx, h.dy, h.dz = r.dx, r.dy, r.dz
    h.t, h.id = r.t, r.id
    h.pixel, h.sample, h.kind, h.power = p.pixel, p.sample, p.kind, p.power
    h.red, h.green, h.blue = p.red, p.green, p.blue


cdef inline void finish_miss(const Ray* r, const Path* p, Film film,
                             const double* background) noexcept nogil:
    """Give the film a missing ray's light: what a shadow ray carries, or the background."""
    if r.kind == SHADOW:
        film_add(film, p.pixel, p.red, p.green, p.blue, 0.0)
    else:
        film_add(
            film, p.pixel, p.red * background[0], p.green * background[1],
            p.blue * background[2], 0.0,
        )
