"""The film in memory, and its averages as rows of an image.

A film element is a pixel, or, in SPD's procedure, a pixel corner that up to four pixels average.
Contributions are summed as 64-bit integers, so the picture does not depend on the order in which
rays finish; averages are taken from the integers, and only then floats appear.

A frame that memory does not hold is rendered in bands of rows, of which the film holds one. Two
bands share the corners between them: their sums go on to the next one.

Several views of one size lie side by side, so that a row of the film is that row of all of them::

    row 0:  view 0, view 1, ...     row 1:  view 0, view 1, ...

Each has the corners at both of its sides for itself.
"""

cimport cython

import numpy as np

from bfrt.records import NO_HIT

# Contributions are in units of 2^-32 (film.pxd).
_UNIT = 2.0**32


@cython.final
cdef class Film:
    """Sums of all samples of a band of rows.

    Parameters
    ----------
    width, height : int
        The size of the image of a view, pixels.
    samples : int
        A pixel; 0 means SPD's procedure: one at each corner.
    held : int, optional
        Rows of the image that are in memory at a time; by default all.
    aovs : sequence of str
        Which of `records.ON_REQUEST` are kept too.
    views : int
        Views that lie side by side.
    """

    def __cinit__(self, int width, int height, int samples, held=None, aovs=(), int views=1):
        self.corners = samples == 0
        self.samples = max(samples, 1)
        self.views = views
        self.across = views * <int64_t>(width + self.corners)
        self.shape = (height + self.corners, self.across)
        self.held = height if held is None else min(held, height)
        elements = (self.held + self.corners) * self.shape[1]
        self.sums = np.zeros((elements, 4), np.int64)
        self.depth_normal = np.zeros((elements, 4), np.float32)
        self.ids = np.empty(elements, np.uint64)
        self.positions = np.empty((elements if "position" in aovs else 0, 3), np.float32)
        self.albedos = np.empty((elements if "albedo" in aovs else 0, 3), np.float32)
        self.numbers = np.empty(0, np.uint32)
        self.lines = np.empty(0, np.uint32)
        self.clear(0)

    def number(self, const uint32_t[::1] numbers):
        """Say which elements of a frame this film has, where it has some only: their numbers."""
        self.numbers = numbers

    def take_rows(self, const uint32_t[::1] rows):
        """Say which rows of a frame's elements this film has, where it has some only."""
        self.lines = rows

    def planes(self):
        """Return the arrays of all elements, each with its value where no ray has met anything."""
        return [
            (np.asarray(self.sums), 0),
            (np.asarray(self.depth_normal), (np.inf, 0, 0, 0)),
            (np.asarray(self.ids), NO_HIT),
            (np.asarray(self.positions), np.inf),
            (np.asarray(self.albedos), 0),
        ]

    def clear(self, int kept):
        """Forget all elements but the first `kept`."""
        for plane, nothing in self.planes():
            plane[kept:] = nothing

    @property
    def end(self):
        """Return the image row after the last that is in memory."""
        return min(self.row + self.held, self.shape[0] - self.corners)

    def elements(self):
        """Return the elements [first, last) of this band that no earlier band had."""
        across = self.shape[1]
        first = self.row + (1 if self.corners and self.row else 0)
        return first * across, (self.end + self.corners) * across

    def advance(self):
        """Go on to the next band, if there is one."""
        cdef int last = self.end - self.row
        if self.end + self.corners == self.shape[0]:
            return
        across = self.shape[1]
        shared = across if self.corners else 0
        for plane, _ in self.planes():
            plane[:shared] = plane[last * across:last * across + shared]
        self.clear(shared)
        self.begin_at(self.row + last)

    def begin_at(self, int row):
        """Begin with the band whose first image row is `row`."""
        self.row = row
        self.first = row * self.across

    def rows(self, int first, int last, int view=0):
        """Return channels of rows [first, last) of a view in this band: a dict of (rows, width).

        R G B A are float32 averages. Z, N and ids, and P and albedo where they are asked for, are
        those of sample 0 (the upper left corner in SPD's procedure) and never averaged; a miss has
        Z = inf, N = 0, id = 2^64 - 1, P = inf in all three, and albedo = 0.
        """
        width = self.shape[1] // self.views - self.corners
        held = (self.held + self.corners, self.views, width + self.corners)
        first, last = first - self.row, last - self.row
        sums = np.asarray(self.sums).reshape(*held, 4)[:, view]
        ids = np.asarray(self.ids).reshape(held)[first:last, view, :width]
        # Four corners of sums below 2^63 would overflow an integer sum; a quarter of each, in
        # float64, is exact up to 2^53 and rounds once beyond, in one order.
        if self.corners:
            quarter = sums[first:last + 1] * 0.25
            upper, lower = quarter[:last - first], quarter[1:]
            mean = (upper[:, :width] + upper[:, 1:]) + (lower[:, :width] + lower[:, 1:])
        else:
            mean = sums[first:last] / self.samples
        color = (mean / _UNIT).astype(np.float32)
        channels = {name: color[:, :, k] for k, name in enumerate("RGBA")}
        for names, plane in (
            (("Z", "N.X", "N.Y", "N.Z"), self.depth_normal),
            (("P.X", "P.Y", "P.Z"), self.positions),
            (("albedo.R", "albedo.G", "albedo.B"), self.albedos),
        ):
            if plane.shape[0]:
                seen = np.asarray(plane).reshape(*held, len(names))[first:last, view, :width]
                channels |= {name: seen[:, :, k] for k, name in enumerate(names)}
        channels["id.lo"] = ids.astype(np.uint32)
        channels["id.hi"] = (ids >> np.uint64(32)).astype(np.uint32)
        return {name: np.ascontiguousarray(channel) for name, channel in channels.items()}
