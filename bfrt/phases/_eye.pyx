"""Eye rays of a pinhole camera, any part of them at a time."""

cimport cython
from libc.stdint cimport int64_t, uint32_t, uint64_t

from bfrt.geometry.far cimport Bounds, advance_far, bounds_of
from bfrt.geometry.vector cimport Line, Vec, add, line, scale, unit, vec
from bfrt.phases.hashing cimport mixed, uniform
from bfrt.records cimport EYE, Queued


@cython.final
cdef class EyeRayGenerator:
    """Makes the eye rays of a view.

    Parameters
    ----------
    view : (4, 3) float64
        Eye, forward, and the vectors from the image's center to its right and upper edges.
    width, height : int
        Pixels.
    samples : int
        A pixel; 0 puts one at each pixel corner instead, (width + 1) (height + 1) in all.
    turn : int
        Coprime with samples: sample s is in column s and row s turn + a hash of the pixel, of
        `samples` columns and rows each.
    bounds : (2, 3) float64
        The scene's.
    """

    cdef Vec eye
    cdef Vec forward
    cdef Vec right
    cdef Vec up
    cdef int width
    cdef int height
    cdef int samples
    cdef int64_t turn
    cdef Bounds bounds

    def __cinit__(self, const double[:, ::1] view, int width, int height, int samples, int64_t turn,
                  const double[:, ::1] bounds):
        self.eye = vec(view[0, 0], view[0, 1], view[0, 2])
        self.forward = vec(view[1, 0], view[1, 1], view[1, 2])
        self.right = vec(view[2, 0], view[2, 1], view[2, 2])
        self.up = vec(view[3, 0], view[3, 1], view[3, 2])
        self.width, self.height = width, height
        self.samples, self.turn = samples, turn
        self.bounds = bounds_of(bounds)

    def generate(self, int64_t first, Queued[::1] out):
        """Make the eye rays of samples first, first + 1, ...

        Parameters
        ----------
        out : (n,) records.QUEUED
            OUT.
        """
        cdef int64_t i
        with nogil:
            for i in range(out.shape[0]):
                self.sample(first + i, &out[i])

    def centers(self, int64_t first, double[:, ::1] out):
        """Make the rays through the middles of pixels first, first + 1, ..., one each.

        Parameters
        ----------
        out : (n, 6) float64
            OUT. Eye, and unit direction.
        """
        cdef int64_t i, pixel
        cdef Vec d
        with nogil:
            for i in range(out.shape[0]):
                pixel = first + i
                d = self.direction(pixel % self.width + 0.5, pixel // self.width + 0.5)
                out[i, 0], out[i, 1], out[i, 2] = self.eye.x, self.eye.y, self.eye.z
                out[i, 3], out[i, 4], out[i, 5] = d.x, d.y, d.z

    cdef Vec direction(self, double x, double y) noexcept nogil:
        """Return the direction to a point of the image, pixels from its upper left corner."""
        cdef Vec d
        x = 2.0 * x / self.width - 1.0
        y = 1.0 - 2.0 * y / self.height
        d = add(self.forward, add(scale(self.right, x), scale(self.up, y)))
        return unit(d)

    cdef void sample(self, int64_t index, Queued* q) noexcept nogil:
        """Make the ray of a sample."""
        cdef int across = self.width + 1 if self.samples == 0 else self.width
        cdef int samples = self.samples
        cdef uint32_t pixel = <uint32_t>index, s = 0
        cdef uint64_t seed, row
        cdef double x = 0.0, y = 0.0
        cdef Line l
        if samples:
            pixel = <uint32_t>(index // samples)
            s = <uint32_t>(index % samples)
            seed = mixed(pixel)
            row = (s * <uint64_t>self.turn + seed % samples) % samples
            x = (s + uniform(mixed(seed + 2 * s))) / samples
            y = (row + uniform(mixed(seed + 2 * s + 1))) / samples
        l = line(self.eye, self.direction(pixel % across + x, pixel // across + y))
        advance_far(&l, &self.bounds)
        q.ox, q.oy, q.oz = l.o.x, l.o.y, l.o.z
        q.dx, q.dy, q.dz = l.d.x, l.d.y, l.d.z
        q.pixel, q.sample, q.kind, q.power = pixel, s, EYE, 0
        q.red = q.green = q.blue = 1.0
