"""Outliers: boxes so large that the grid is better without them (bfrt/store/extent.py).

Every ray is tested against them before its first walk, which their hits then shorten.
"""

cimport cython
from cpython.bytes cimport PyBytes_AS_STRING
from cpython.mem cimport PyMem_RawFree, PyMem_RawMalloc

from libc.stdint cimport int64_t, uint32_t

from bfrt.geometry.box cimport box_span
from bfrt.geometry.shape cimport BoxHit, shape_bounds, shape_load
from bfrt.phases.crossings cimport CrossingBuffer, cross, hand_over
from bfrt.phases.nearest cimport ray_bad, ray_line
from bfrt.records cimport Ray
from bfrt.scan.given_order cimport GivenOrder
from bfrt.scan.geometry cimport GeometryCursor, next_records, vertices_in
from bfrt.ids import index_of, stream_of
from bfrt.scan.files import StreamFiles


cdef enum:
    BUFFER = 4096  # bytes of a read buffer


@cython.final
cdef class Outliers:
    """Holds the outliers of a group in memory.

    Parameters
    ----------
    store : bfrt.store.store.Store
    group : bfrt.store.store.Group
    order : GivenOrder
    """

    def __cinit__(self, store, group, GivenOrder order not None):
        cdef GeometryCursor g
        cdef uint32_t count
        cdef Outlier* out
        cdef bytes record
        self.records = []
        self.order = order
        self.outliers = <Outlier*>PyMem_RawMalloc(max(1, len(group.outliers)) * sizeof(Outlier))
        if self.outliers == NULL:
            raise MemoryError("a list of outliers")
        streams = {stream.number: stream for stream in group.streams}
        for id in group.outliers:
            index, stream = index_of(id), streams[stream_of(id)]
            g = GeometryCursor(stream, store.origin, StreamFiles(stream, False), BUFFER)
            g.window(index, index + 1)
            next_records(g, 1)
            count = vertices_in(g, 0)
            record = g.block[:g.stride * (count if count else 1)]
            self.records.append(record)
            out = &self.outliers[self.count]
            out.id = id
            if shape_load(
                g.kind, <const unsigned char*>PyBytes_AS_STRING(record), count, &g.frame,
                &out.shape,
            ):
                shape_bounds(&out.shape, &out.box)
                self.count += 1

    def __dealloc__(self):
        PyMem_RawFree(self.outliers)

    def cross(self, const Ray[::1] rays, int64_t first, int64_t last, double padding,
              CrossingBuffer crossings not None):
        """Find where rays cross outliers: all hits, not only the nearest.

        Parameters
        ----------
        rays : (n,) records.RAY
            IN. Rays [first, last) are tested.
        padding : float
            d, by which boxes are padded (docs/algorithm.rst, Exactness).
        crossings : CrossingBuffer
            OUT. Handed over at the end.

        Returns
        -------
        box_tests, object_tests : int
        """
        cdef BoxHit m
        cdef const Outlier* out
        cdef int64_t i, box_tests = 0, object_tests = 0
        cdef int k
        with nogil:
            for i in range(first, last):
                if ray_bad(&rays[i]):
                    continue
                m.line = ray_line(&rays[i])
                m.mark = <uint32_t>i
                for k in range(self.count):
                    out = &self.outliers[k]
                    box_tests += 1
                    if box_span(&out.box, padding, &m.line, &m.span):
                        object_tests += 1
                        cross(crossings, &out.shape, &m, rays[i].t, out.id)
            hand_over(crossings)
        return box_tests, object_tests
