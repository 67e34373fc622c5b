"""Cursors over boxes."""

cimport cython
from libc.stdint cimport int64_t, uint32_t

from bfrt.geometry.coordinates cimport frame_of
from bfrt.records cimport BOX_BYTES, CODE_BYTES, OFFSET_BYTES
from bfrt.scan.runs cimport polygon_end, prefetch_runs

from bfrt.scan.files import wrong_ends


@cython.final
cdef class BoxCursor:
    """Reads the boxes of a stream, forwards.

    An outlier, which rays meet before they enter the grid, is passed with an empty box, as a
    degenerate object is: nothing in the grid meets it again.

    Parameters
    ----------
    stream : bfrt.store.store.Stream
        The stream to read.
    origin : sequence of 3 float
        The store's origin.
    files : bfrt.scan.files.StreamFiles
        The open files.
    outliers : (n,) int64
        Indices of this stream's outliers, ascending.
    capacity : int
        Bytes of the read buffer.
    """

    def __cinit__(self, stream, origin, files, const int64_t[::1] outliers, size_t capacity):
        self.number = stream.number
        self.largest, self.vertices = stream.largest, stream.vertices
        self.outliers = outliers
        self.frame = frame_of(stream.wide, origin)
        self.kind = stream.kind
        if stream.boxed:
            self.exact = self.reader = files.reader("boxes", capacity)
            self.bytes = BOX_BYTES
        else:
            self.geometry = self.reader = files.reader("geometry", capacity)
            self.bytes = stream.stride
        if files.lazy and stream.quantised:
            self.quantised = files.reader("quantised", capacity // 4)
        if files.lazy and stream.kind.counted:
            self.offsets = files.reader("offsets", capacity // 16)
        self.rewind()

    def rewind(self, bint prefetched=False):
        """Begin again at the first object.

        Parameters
        ----------
        prefetched : bool
            Whether boxes are prefetched before they are read: they are then the
            quantised ones, if there are any. Otherwise they are read in order.
        """
        for reader in (self.exact, self.quantised, self.geometry, self.offsets):
            if reader is not None:
                reader.rewind(prefetched)
        self.index = self.outlier = self.ahead = 0
        self.vertex = 0
        self.coded = prefetched and self.quantised is not None
        if self.coded:
            self.reader, self.bytes = self.quantised, CODE_BYTES
        elif self.geometry is None:
            self.reader, self.bytes = self.exact, BOX_BYTES

    def prefetch(self, const int64_t[:, ::1] ranges):
        """Have the system begin to read the boxes of those ranges of objects.

        That may wait until earlier requests are done.
        """
        with nogil:
            prefetch_runs(self.reader, ranges, self.bytes)
            if self.offsets is not None:
                prefetch_runs(self.offsets, ranges, OFFSET_BYTES)

    def choose(self, const int64_t[:, ::1] ranges, bint prefetched):
        """Go forward to ranges of objects.

        Parameters
        ----------
        ranges : (n, 2) int64
            First and end of each, ascending.
        prefetched : bool
            Whether `prefetch` was called for them; otherwise they are read in order.
        """
        self.reader.expect(prefetched)
        if self.offsets is not None:
            self.offsets.expect(prefetched)
        self.window(ranges[0, 0], ranges[ranges.shape[0] - 1, 1])

    cpdef int window(self, int64_t first, int64_t last) except -1:
        """Go forward to object `first`, to read up to `last` (exclusive)."""
        if self.offsets is not None:
            self.vertex = <uint32_t>polygon_end(self.offsets, first - 1)
            self.offsets.window(first * OFFSET_BYTES, last * OFFSET_BYTES)
        self.reader.window(first * self.bytes, last * self.bytes)
        self.index = first
        self.ahead = 0
        while self.outlier < self.outliers.shape[0] and self.outliers[self.outlier] < first:
            self.outlier += 1
        return 0

    cdef int refuse_ends(self, int n) except -1 nogil:
        """Raise for polygons of the block that end where they cannot."""
        cdef int i
        with gil:
            ends = tuple([self.ends[i] for i in range(n + 1)])
            raise wrong_ends(self.offsets.file.path, self.index, ends)
