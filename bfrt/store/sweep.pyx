"""Sweeping a stream: what the paper writes as ``for (each object on disk)``.

An outlier, which rays meet before they enter the grid, is passed with an empty box, as a
degenerate object is: nothing in the grid meets it again.
"""

cimport cython
from libc.stdint cimport int64_t, uint32_t

from bfrt.geometry.eight cimport BOXES
from bfrt.geometry.vector cimport vec
from bfrt.records cimport BOX_BYTES, CODE_BYTES, OFFSET_BYTES, POLYGON, SPHERE
from bfrt.streams.reader cimport Reader, skip, take, want

import numpy as np

from bfrt.errors import StoreError
from bfrt.streams.reader import Tape


cdef void ask_runs(Reader reader, const int64_t[:, ::1] ranges, int64_t size) noexcept nogil:
    """Ask for things of so many bytes: ranges of them, and what is between where that is short."""
    cdef int64_t begin, k = 0
    while k < ranges.shape[0]:
        begin = ranges[k, 0] * size
        reader.ask(begin, run_end(ranges, &k, reader.gap // size) * size)
        k += 1


@cython.final
cdef class Sweep:
    """Readers over one stream's files.

    Parameters
    ----------
    stream : bfrt.store.store.Stream
        What to sweep.
    origin : sequence of 3 float
        The store's.
    outliers : (n,) int64
        Indices of this stream's outliers, ascending.
    capacity : int
        Bytes of each read buffer; more where the largest polygon needs it.
    tapes : tuple of Tape, optional
        The open files of another sweep, to share.
    lazy : bool
        Whether only those records are read that are asked for (the paper's refinement G).
    """

    def __cinit__(self, stream, origin, const int64_t[::1] outliers, size_t capacity, tapes=None,
                  bint lazy=False):
        cdef int64_t largest
        names = ["geometry"]
        self.kind = stream.kind
        self.number = stream.number
        self.stride = stream.stride
        self.frame.wide = stream.wide
        self.frame.origin = vec(origin[0], origin[1], origin[2])
        self.outliers = outliers
        if self.kind != SPHERE:
            names.append("boxes")
        if self.kind == POLYGON:
            names.append("offsets")
        self.material = stream.material
        self.material_bytes = stream.material_bytes
        if self.material_bytes:
            names.append("materials")
        if stream.quantised and lazy:
            names.append("quantised")
        self.tapes = tapes or tuple(Tape(stream.path(name), lazy) for name in names)
        largest = self.stride * max(BOXES, stream.largest)
        self.lazy = lazy
        self.delays = lazy and self.kind != SPHERE
        room = {
            "geometry": max(capacity, largest), "boxes": capacity, "quantised": capacity // 4,
            "offsets": capacity // 8, "materials": capacity // 8,
        }  # fmt: skip
        readers = {
            name: Reader(tape, room[name], lazy)
            for name, tape in zip(names, self.tapes, strict=True)
        }
        self.geometry = readers["geometry"]
        self.boxes = readers.get("boxes")
        self.quantised = readers.get("quantised")
        self.offsets = readers.get("offsets")
        self.materials = readers.get("materials")
        self.readers = tuple(readers.values())
        self.rewind()

    def rewind(self, bint asked=False):
        """Begin again at the first object.

        Parameters
        ----------
        asked : bool
            Whether what is read is asked for before: boxes by `ask`, others by `picks`. Boxes are
            then those that are quantised, if there are any. Otherwise all are read in order, but
            for geometry that is asked for later.
        """
        for reader in self.readers:
            reader.rewind(asked or (self.delays and reader is self.geometry))
        self.index = self.vertex = self.outlier = self.fetched = self.wanted = 0
        self.coded = asked and self.quantised is not None
        if self.coded:
            self.box_reader, self.box_bytes = self.quantised, CODE_BYTES
        elif self.boxes is not None:
            self.box_reader, self.box_bytes = self.boxes, BOX_BYTES
        else:
            self.box_reader, self.box_bytes = self.geometry, self.stride
        if self.delays:
            self.geometry.window(0, self.geometry.tape.size)

    def ask(self, const int64_t[:, ::1] ranges):
        """Have the system begin to read the boxes of those ranges of objects.

        That may wait until earlier requests are done.
        """
        with nogil:
            ask_runs(self.box_reader, ranges, self.box_bytes)
            if self.offsets is not None:
                ask_runs(self.offsets, ranges, OFFSET_BYTES)

    def chosen(self, const int64_t[:, ::1] ranges, bint asked):
        """Go forward to ranges of objects whose boxes were asked for, or are read in order.

        Parameters
        ----------
        ranges : (n, 2) int64
            First and end of each, ascending.
        asked : bool
            Whether `ask` was called for them.
        """
        self.box_reader.expect(asked)
        if self.offsets is not None:
            self.offsets.expect(asked)
        self.window(ranges[0, 0], ranges[ranges.shape[0] - 1, 1])

    def picks(self, const int64_t[:, ::1] ranges):
        """Go forward to objects, ranges of one each, that are going to be picked."""
        cdef int64_t first = ranges[0, 0], last = ranges[ranges.shape[0] - 1, 1]
        self.window(first, last)
        self.material_window(first, last)
        self.objects = ranges
        if self.materials is not None:
            ask_runs(self.materials, ranges, self.material_bytes)
        self.picked = self.vertices_of(ranges) if self.kind == POLYGON else ranges
        ask_runs(self.geometry, self.picked, self.stride)
        self.picking = self.known = 0

    cdef object vertices_of(self, const int64_t[:, ::1] ranges):
        """Where polygons begin and end, in vertices."""
        cdef int64_t[:, ::1] out
        cdef int64_t k, last, index, known = 0
        cdef bint far
        found = np.empty((ranges.shape[0], 2), np.int64)
        out = found
        ask_runs(self.offsets, ranges, OFFSET_BYTES)
        for k in range(ranges.shape[0]):
            index, far = ranges[k, 0], ranges[k, 0] >= known
            if far:
                want(self.offsets, self.index * OFFSET_BYTES)
            if index > self.index:
                skip(self.offsets, (index - self.index - 1) * OFFSET_BYTES)
            if far:
                last = k
                known = run_end(ranges, &last, self.offsets.gap // OFFSET_BYTES)
                want(self.offsets, known * OFFSET_BYTES)
            if index > self.index:
                self.vertex = (<const uint32_t*>take(self.offsets, OFFSET_BYTES))[0]
            out[k, 0] = self.vertex
            self.vertex = (<const uint32_t*>take(self.offsets, OFFSET_BYTES))[0]
            out[k, 1] = self.vertex
            self.index = index + 1
        return found

    cpdef int window(self, int64_t first, int64_t last) except -1:
        """Go forward to object `first`, to read up to `last` (exclusive).

        Where geometry is read later, its reader stays where it is.
        """
        cdef int64_t begin = first, end = last
        if self.kind == POLYGON:
            begin = self.vertex = self.end_of(first - 1)
            end = self.end_of(last - 1)
            if begin > end or end * self.stride > self.geometry.tape.size:
                raise StoreError(
                    f"{self.offsets.tape.path}: objects {first} to {last}: found vertices "
                    f"{begin} to {end}, expected ascending ones that are there"
                )
            self.offsets.window(first * OFFSET_BYTES, last * OFFSET_BYTES)
        if not self.delays:
            self.geometry.window(begin * self.stride, end * self.stride)
            self.fetched = begin
        if self.boxes is not None:
            self.boxes.window(first * BOX_BYTES, last * BOX_BYTES)
        if self.quantised is not None:
            self.quantised.window(first * CODE_BYTES, last * CODE_BYTES)
        self.index = first
        self.wanted = 0
        while self.outlier < self.outliers.shape[0] and self.outliers[self.outlier] < first:
            self.outlier += 1
        return 0

    cdef int64_t end_of(self, int64_t index) except -1:
        """Where polygon `index` ends, in vertices: one read, not part of the sweep."""
        cdef Reader single
        if index < 0:
            return 0
        single = Reader(self.offsets.tape, OFFSET_BYTES)
        single.window(index * OFFSET_BYTES, (index + 1) * OFFSET_BYTES)
        return (<const uint32_t*>take(single, OFFSET_BYTES))[0]

    def counts(self):
        """Objects whose geometry was read since the last call."""
        count, self.geometry_read = self.geometry_read, 0
        return count

    cdef int refuse(self, int64_t vertex) except -1 nogil:
        """Polygons whose ends do not ascend would have the reader go back."""
        with gil:
            raise StoreError(
                f"{self.offsets.tape.path}: before object {self.index}: found a polygon that "
                f"begins at vertex {vertex}, expected {self.fetched} or more"
            )

    cpdef int material_window(self, int64_t first, int64_t last) except -1:
        """The same for materials, which only shading reads."""
        self.material_at = first
        self.material_known = 0
        if self.materials is not None:
            self.materials.window(first * self.material_bytes, last * self.material_bytes)
        return 0
