"""The memory of crossings that wait to be handed over."""

cimport cython
from libc.stdint cimport int64_t

import numpy as np

from bfrt.records import CROSSING


@cython.final
cdef class CrossingBuffer:
    """Holds one thread's crossings, until it is full or a sweep ends.

    Parameters
    ----------
    room : int
        Crossings at the most.
    emit : callable
        Called with them, (n,) of records.CROSSING, whose memory is used again.
    """

    def __cinit__(self, int64_t room, emit):
        self.records = self.crossings = np.empty(room, CROSSING)
        self.emit = emit
