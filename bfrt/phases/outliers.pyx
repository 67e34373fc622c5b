"""Outliers: boxes so large that the grid is better without them (bfrt/scene/extent.py).

Every ray is tested against them before its first walk, which their hits then shorten.
"""

cimport cython
from cpython.bytes cimport PyBytes_AS_STRING
from cpython.mem cimport PyMem_RawFree, PyMem_RawMalloc

import numpy as np

from bfrt.geometry.shape cimport shape_bounds, shape_load
from bfrt.scene.sweep cimport Sweep, advance
from bfrt.records import INDEX_BITS
from bfrt.scene.sweep import Sweep as SweepType


@cython.final
cdef class Outliers:
    """The outliers of a group.

    Parameters
    ----------
    store : bfrt.scene.store.Store
    group : bfrt.scene.store.Group
    """

    def __cinit__(self, store, group):
        cdef Sweep sweep
        cdef Outlier* out
        cdef bytes record
        self.records = []
        self.outliers = <Outlier*>PyMem_RawMalloc(max(1, len(group.outliers)) * sizeof(Outlier))
        if self.outliers == NULL:
            raise MemoryError("outliers")
        streams = {stream.number: stream for stream in group.streams}
        for id in group.outliers:
            index = id & ((1 << INDEX_BITS) - 1)
            stream = streams[id >> INDEX_BITS]
            sweep = SweepType(stream, store.origin, np.empty(0, np.int64), 4096)
            sweep.window(index, index + 1)
            advance(sweep)
            size = sweep.stride * (sweep.count if sweep.count else 1)
            record = sweep.record[:size]
            self.records.append(record)
            out = &self.outliers[self.count]
            out.id = id
            if shape_load(
                sweep.kind, <const unsigned char*>PyBytes_AS_STRING(record), sweep.count,
                &sweep.frame, &out.shape,
            ):
                shape_bounds(&out.shape, &out.box)
                self.count += 1

    def __dealloc__(self):
        PyMem_RawFree(self.outliers)
