"""Eye rays of a pinhole camera, any part of them at a time."""

from libc.stdint cimport int64_t, uint32_t, uint64_t

from bfrt.geometry.far cimport Bounds, advance_far, bounds_of
from bfrt.geometry.vector cimport Line, Vec, add, line, scale, unit, vec
from bfrt.records cimport EYE, Queued


cdef inline uint64_t mixed(uint64_t x) noexcept nogil:
    """Hash x: the finalizer of SplitMix64 (Steele, Lea and Flood 2014)."""
    x += <uint64_t>0x9E3779B97F4A7C15
    x = (x ^ (x >> 30)) * <uint64_t>0xBF58476D1CE4E5B9
    x = (x ^ (x >> 27)) * <uint64_t>0x94D049BB133111EB
    return x ^ (x >> 31)


cdef inline double uniform(uint64_t x) noexcept nogil:
    return (x >> 11) * (1.0 / 9007199254740992.0)


def eye_rays(int64_t first, Queued[::1] out, const double[:, ::1] view, int width, int height,
             int samples, int64_t turn, const double[:, ::1] bounds):
    """Make the eye rays of samples first, first + 1, ...

    Parameters
    ----------
    out : (n,) records.QUEUED
        OUT.
    view : (4, 3) float64
        Eye, forward, and the vectors from the image's center to its right and upper edges.
    samples : int
        A pixel; 0 puts one at each pixel corner instead, (width + 1) (height + 1) in all.
    turn : int
        Coprime with samples: sample s is in column s and row s turn + a hash of the pixel, of
        `samples` columns and rows each.
    bounds : (2, 3) float64
        The scene's.
    """
    cdef Vec eye = vec(view[0, 0], view[0, 1], view[0, 2])
    cdef Vec forward = vec(view[1, 0], view[1, 1], view[1, 2])
    cdef Vec right = vec(view[2, 0], view[2, 1], view[2, 2])
    cdef Vec up = vec(view[3, 0], view[3, 1], view[3, 2])
    cdef Bounds b = bounds_of(bounds)
    cdef int64_t i, index
    cdef uint32_t pixel, s
    cdef uint64_t seed, row
    cdef double x, y
    cdef int across = width + 1 if samples == 0 else width
    cdef Line l
    cdef Queued* q
    with nogil:
        for i in range(out.shape[0]):
            index = first + i
            s = 0
            x = y = 0.0
            pixel = <uint32_t>index
            if samples:
                pixel = <uint32_t>(index // samples)
                s = <uint32_t>(index % samples)
                seed = mixed(pixel)
                row = (s * <uint64_t>turn + seed % samples) % samples
                x = (s + uniform(mixed(seed + 2 * s))) / samples
                y = (row + uniform(mixed(seed + 2 * s + 1))) / samples
            x = 2.0 * (pixel % across + x) / width - 1.0
            y = 1.0 - 2.0 * (pixel // across + y) / height
            l = line(eye, unit(add(forward, add(scale(right, x), scale(up, y)))))
            advance_far(&l, &b)
            q = &out[i]
            q.ox, q.oy, q.oz = l.o.x, l.o.y, l.o.z
            q.dx, q.dy, q.dz = l.d.x, l.d.y, l.d.z
            q.pixel, q.sample, q.kind, q.power = pixel, s, EYE, 0
            q.red = q.green = q.blue = 1.0
