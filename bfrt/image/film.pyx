"""The film in memory, and its averages as rows of an image.

A film element is a pixel, or, in SPD's procedure, a pixel corner that up to four pixels average.
Contributions are summed as 64-bit integers, so the picture does not depend on the order in which
rays finish; averages are taken from the integers, and only then floats appear.
"""

cimport cython

import numpy as np

from bfrt.records import NO_HIT

# Contributions are in units of 2^-32 (film.pxd).
UNIT = 2.0**32


@cython.final
cdef class Film:
    """Sums of all samples.

    Parameters
    ----------
    width, height : int
        Of the image, pixels.
    samples : int
        A pixel; 0 means SPD's procedure: one at each corner.
    """

    def __cinit__(self, int width, int height, int samples):
        self.corners = samples == 0
        self.samples = max(samples, 1)
        self.shape = (height + self.corners, width + self.corners)
        elements = self.shape[0] * self.shape[1]
        self.sums = np.zeros((elements, 4), np.int64)
        self.depth_normal = np.zeros((elements, 4), np.float32)
        self.depth_normal[:, 0] = np.inf
        self.ids = np.full(elements, NO_HIT, np.uint64)

    def rows(self, int first, int last):
        """Channels of the image rows [first, last): a dict of (rows, width) arrays.

        R G B A are float32 averages. Z, N and ids are those of sample 0 (the upper left corner
        in SPD's procedure) and never averaged; a miss has Z = inf, N = 0 and id = 2^64 - 1.
        """
        width = self.shape[1] - self.corners
        sums = np.asarray(self.sums).reshape(*self.shape, 4)
        seen = np.asarray(self.depth_normal).reshape(*self.shape, 4)[first:last, :width]
        ids = np.asarray(self.ids).reshape(self.shape)[first:last, :width]
        # Four corners of sums below 2^63 would overflow an integer sum; a quarter of each, in
        # float64, is exact up to 2^53 and rounds once beyond, in one order.
        if self.corners:
            quarter = sums[first:last + 1] * 0.25
            upper, lower = quarter[:last - first], quarter[1:]
            mean = (upper[:, :width] + upper[:, 1:]) + (lower[:, :width] + lower[:, 1:])
        else:
            mean = sums[first:last] / self.samples
        color = (mean / UNIT).astype(np.float32)
        channels = {name: color[:, :, k] for k, name in enumerate("RGBA")}
        for k, name in enumerate(("Z", "N.X", "N.Y", "N.Z")):
            channels[name] = seen[:, :, k]
        channels["id.lo"] = ids.astype(np.uint32)
        channels["id.hi"] = (ids >> np.uint64(32)).astype(np.uint32)
        return {name: np.ascontiguousarray(channel) for name, channel in channels.items()}
