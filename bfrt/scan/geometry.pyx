"""Cursors over geometry."""

cimport cython
from libc.stdint cimport int64_t, uint32_t

from bfrt.geometry.coordinates cimport frame_of
from bfrt.geometry.packet cimport BOXES
from bfrt.records cimport OFFSET_BYTES
from bfrt.scan.runs cimport polygon_end, prefetch_runs, run_end, take_ends
from bfrt.streams.reader cimport read_ahead, skip, take

import numpy as np

from bfrt.errors import StoreError
from bfrt.scan.files import wrong_ends


@cython.final
cdef class GeometryCursor:
    """Reads the geometry of a stream, forwards.

    Parameters
    ----------
    stream : bfrt.store.store.Stream
        The stream to read.
    origin : sequence of 3 float
        The store's origin.
    files : bfrt.scan.files.StreamFiles
        The open files.
    capacity : int
        Bytes of the read buffer; more where the largest polygon needs it.
    """

    def __cinit__(self, stream, origin, files, size_t capacity):
        self.kind = stream.kind
        self.counted = stream.kind.counted
        self.number = stream.number
        self.stride = stream.stride
        self.frame = frame_of(stream.wide, origin)
        self.largest, self.vertices = stream.largest, stream.vertices
        largest = self.stride * max(BOXES, stream.largest)
        self.reader = files.reader("geometry", max(capacity, largest))
        if self.counted:
            self.offsets = files.reader("offsets", capacity // 16)
        self.rewind()

    def rewind(self, bint prefetched=False):
        """Begin again at the first object.

        Parameters
        ----------
        prefetched : bool
            Whether what is read is prefetched; otherwise it is read in order.
        """
        self.reader.rewind(prefetched)
        if self.offsets is not None:
            self.offsets.rewind(prefetched)
        self.at = self.index = self.picking = self.known = 0
        self.vertex = 0
        self.prefetched = prefetched
        if prefetched:
            self.reader.window(0, self.reader.file.size)

    cpdef int window(self, int64_t first, int64_t last) except -1:
        """Go forward to object `first`, to read in order up to `last` (exclusive).

        Raises
        ------
        StoreError
            If polygons end where they cannot.
        """
        cdef int64_t begin = first, end = last
        if self.counted:
            begin, end = self.place(first, last)
        self.reader.window(begin * self.stride, end * self.stride)
        self.at = begin
        self.index = first
        return 0

    cdef (int64_t, int64_t) place(self, int64_t first, int64_t last) except *:
        """Go forward to the offset of polygon `first`; return where those up to `last` begin and
        end, in vertices."""
        cdef int64_t begin = polygon_end(self.offsets, first - 1)
        cdef int64_t end = polygon_end(self.offsets, last - 1)
        if begin > end or end * self.stride > self.reader.file.size:
            raise wrong_ends(self.offsets.file.path, first, (begin, end))
        self.offsets.window(first * OFFSET_BYTES, last * OFFSET_BYTES)
        self.vertex = <uint32_t>begin
        return begin, end

    def pick(self, const int64_t[:, ::1] objects):
        """Go forward to objects, which `pick_record` then gives; their records are prefetched.

        Parameters
        ----------
        objects : (n, 2) int64
            Ranges of one each, ascending.
        """
        cdef int64_t first = objects[0, 0], last = objects[objects.shape[0] - 1, 1]
        if self.counted:
            self.place(first, last)
            self.index = first
            self.ranges = self.vertices_of(objects)
        else:
            self.ranges = objects
        if not self.prefetched:
            self.at = self.ranges[0, 0]
            self.reader.window(
                self.at * self.stride, self.ranges[self.ranges.shape[0] - 1, 1] * self.stride
            )
        prefetch_runs(self.reader, self.ranges, self.stride)
        self.picking = self.known = 0

    cdef object vertices_of(self, const int64_t[:, ::1] ranges):
        """Find where polygons begin and end, in vertices."""
        cdef int64_t[:, ::1] out
        cdef int64_t k, last, index, known = 0
        cdef uint32_t ends[2]
        cdef bint far
        found = np.empty((ranges.shape[0], 2), np.int64)
        out = found
        prefetch_runs(self.offsets, ranges, OFFSET_BYTES)
        for k in range(ranges.shape[0]):
            index, far = ranges[k, 0], ranges[k, 0] >= known
            if far:
                read_ahead(self.offsets, self.index * OFFSET_BYTES)
            if index > self.index:
                skip(self.offsets, (index - self.index - 1) * OFFSET_BYTES)
            if far:
                last = k
                known = run_end(ranges, &last, self.offsets.gap // OFFSET_BYTES)
                read_ahead(self.offsets, known * OFFSET_BYTES)
            if index > self.index:
                self.vertex = (<const uint32_t*>take(self.offsets, OFFSET_BYTES))[0]
            ends[0] = self.vertex
            if not take_ends(self.offsets, ends, 1, self.largest, self.vertices):
                self.refuse_end(index, ends)
            out[k, 0], out[k, 1] = ends[0], ends[1]
            self.vertex = ends[1]
            self.index = index + 1
        return found

    cdef int refuse(self, int64_t vertex) except -1 nogil:
        """Raise for polygons whose ends do not ascend: the reader would have to go back."""
        with gil:
            raise StoreError(
                f"{self.offsets.file.path}: before object {self.index}: found a polygon that "
                f"begins at vertex {vertex}, expected {self.at} or more"
            )

    cdef int refuse_end(self, int64_t index, const uint32_t* ends) except -1 nogil:
        """Raise for a polygon that ends where it cannot."""
        with gil:
            raise wrong_ends(self.offsets.file.path, index, (ends[0], ends[1]))

    def counts(self):
        """Count the objects whose geometry was read since the last call."""
        count, self.objects_read = self.objects_read, 0
        return count
