"""Eye rays of pinhole cameras whose views lie side by side, any part of them at a time.

A *line* is a row of one view: the film's elements are row after row, and of each the lines of all
views. What is made of an element's number inside its view does not depend on the other views.
"""

cimport cython
from libc.stdint cimport int64_t, uint32_t, uint64_t

import numpy as np

from bfrt.geometry.far cimport Bounds, advance_far, bounds_of
from bfrt.geometry.vector cimport Line, Vec, add, line, scale, unit, vec
from bfrt.phases.hashing cimport mixed, uniform
from bfrt.records cimport EYE, Queued


# What the rays of a line have in common.
cdef struct Eye:
    Vec place
    Vec forward
    Vec right
    Vec up
    int64_t before   # what an element's number inside the view is less than that in the film


@cython.final
cdef class EyeRayGenerator:
    """Makes the eye rays of views of one size.

    Parameters
    ----------
    views : (n, 4, 3) float64
        Of each the eye, forward, and the vectors from the image's center to its right and upper
        edges.
    width, height : int
        Pixels of a view.
    samples : int
        A pixel; 0 puts one at each pixel corner instead, (width + 1) (height + 1) of a view.
    turn : int
        Coprime with samples: sample s is in column s and row s turn + a hash of the pixel, of
        `samples` columns and rows each.
    bounds : (2, 3) float64
        The scene's.
    """

    cdef const double[:, :, ::1] views
    cdef int width
    cdef int height
    cdef int samples
    cdef int64_t turn
    cdef Bounds bounds
    cdef const uint32_t[::1] rows  # row of the film: which one of the frame; or none: the same

    def __cinit__(self, const double[:, :, ::1] views, int width, int height, int samples,
                  int64_t turn, const double[:, ::1] bounds):
        self.views = views
        self.width, self.height = width, height
        self.samples, self.turn = samples, turn
        self.bounds = bounds_of(bounds)
        self.rows = np.empty(0, np.uint32)

    def take_rows(self, const uint32_t[::1] rows):
        """Say which rows of the frame the film has, where it has some only."""
        self.rows = rows

    def generate(self, int64_t first, Queued[::1] out):
        """Make the eye rays of samples first, first + 1, ...

        Parameters
        ----------
        out : (n,) records.QUEUED
            OUT.
        """
        cdef int64_t each = max(1, self.samples), across = self.across()
        cdef int64_t at = 0, end, i, number
        cdef Eye eye
        with nogil:
            while at < out.shape[0]:
                number = (first + at) // each // across
                eye = self.eye_of(number)
                end = min(<int64_t>out.shape[0], (number + 1) * across * each - first)
                for i in range(at, end):
                    self.sample(&eye, first + i, &out[i])
                at = end

    def centers(self, int64_t first, double[:, ::1] out):
        """Make the rays through the middles of the first view's pixels first, first + 1, ...

        Parameters
        ----------
        out : (n, 6) float64
            OUT. Eye, and unit direction.
        """
        cdef Eye eye = self.eye_of(0)
        cdef int64_t i, pixel
        cdef Vec d
        with nogil:
            for i in range(out.shape[0]):
                pixel = first + i
                d = self.direction(&eye, pixel % self.width + 0.5, pixel // self.width + 0.5)
                out[i, 0], out[i, 1], out[i, 2] = eye.place.x, eye.place.y, eye.place.z
                out[i, 3], out[i, 4], out[i, 5] = d.x, d.y, d.z

    cdef Vec direction(self, const Eye* eye, double x, double y) noexcept nogil:
        """Return the direction to a point of the image, pixels from its upper left corner."""
        x = 2.0 * x / self.width - 1.0
        y = 1.0 - 2.0 * y / self.height
        return unit(add(eye.forward, add(scale(eye.right, x), scale(eye.up, y))))

    cdef int64_t across(self) noexcept nogil:
        """Return the elements of a line."""
        return self.width + 1 if self.samples == 0 else self.width

    cdef Eye eye_of(self, int64_t number) noexcept nogil:
        """Return what the rays of line `number` have in common."""
        cdef int64_t views = self.views.shape[0]
        cdef const double* v = &self.views[number % views, 0, 0]
        cdef int64_t row = number // views
        cdef Eye eye
        eye.place, eye.forward = vec(v[0], v[1], v[2]), vec(v[3], v[4], v[5])
        eye.right, eye.up = vec(v[6], v[7], v[8]), vec(v[9], v[10], v[11])
        if self.rows.shape[0]:
            row = self.rows[row]
        eye.before = (number - row) * self.across()
        return eye

    cdef void sample(self, const Eye* eye, int64_t index, Queued* q) noexcept nogil:
        """Make the ray of a sample."""
        cdef int across = <int>self.across()
        cdef int samples = self.samples
        cdef uint32_t element = <uint32_t>index, s = 0, pixel
        cdef uint64_t seed, row
        cdef double x = 0.0, y = 0.0
        cdef Line l
        if samples:
            element = <uint32_t>(index // samples)
            s = <uint32_t>(index % samples)
        pixel = <uint32_t>(element - eye.before)
        if samples:
            seed = mixed(pixel)
            row = (s * <uint64_t>self.turn + seed % samples) % samples
            x = (s + uniform(mixed(seed + 2 * s))) / samples
            y = (row + uniform(mixed(seed + 2 * s + 1))) / samples
        l = line(eye.place, self.direction(eye, pixel % across + x, pixel // across + y))
        advance_far(&l, &self.bounds)
        q.ox, q.oy, q.oz = l.o.x, l.o.y, l.o.z
        q.dx, q.dy, q.dz = l.d.x, l.d.y, l.d.z
        q.pixel, q.sample, q.kind, q.power = element, s, EYE, 0
        q.red = q.green = q.blue = 1.0
