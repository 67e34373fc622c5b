"""Memory for rays that wait for geometry."""

cimport cython

import numpy as np

from bfrt.records import DELAYED, DELAYED_BYTES

#: What one worker's take.
DELAYS_BYTES = 2 * HALF * DELAYED_BYTES


@cython.final
cdef class DeferredTests:
    """Holds one worker's rays that wait for geometry, between the calls of a sweep.

    Parameters
    ----------
    padding : float
        d, by which boxes are padded (docs/algorithm.rst, Exactness).
    """

    def __cinit__(self, double padding):
        self.padding = padding
        self.halves = np.empty((2, HALF), DELAYED)
        end_delays(self)
