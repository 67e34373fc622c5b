"""Scans of streams."""

cimport cython
from libc.stdint cimport int64_t

from bfrt.scan.boxes cimport BoxCursor
from bfrt.scan.column cimport ColumnCursor
from bfrt.scan.geometry cimport GeometryCursor


@cython.final
cdef class StreamScan:
    """Holds one worker's cursors over a stream.

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
        Bytes of a read buffer.

    Attributes
    ----------
    boxes, geometry, materials, ids
        The cursors.
    lazy : bool
        Whether only those records are read that are needed (the paper's refinement G).
    deferred : bool
        Whether rays that meet a box wait for the object's geometry: not where boxes are worked out
        of that.
    """

    def __cinit__(self, stream, origin, files, const int64_t[::1] outliers, size_t capacity):
        self.kind = stream.kind
        self.number = stream.number
        self.lazy = files.lazy
        self.deferred = self.lazy and stream.boxed
        self.in_step = not self.lazy and stream.boxed
        self.boxes = BoxCursor(stream, origin, files, outliers, capacity)
        self.geometry = GeometryCursor(stream, origin, files, capacity)
        self.materials = ColumnCursor(
            files, "materials", stream.material_bytes, capacity // 8, stream.material,
            stream.first_material,
        )
        self.ids = ColumnCursor(files, "ids", stream.id_bytes, capacity // 8)

    def rewind(self, bint prefetched=False):
        """Begin again at the first object: boxes are read in order, or are prefetched.

        Where geometry is read later than boxes it is prefetched in either case.
        """
        self.boxes.rewind(prefetched)
        self.geometry.rewind(self.lazy)
        self.materials.rewind(self.lazy)
        self.ids.rewind(self.lazy)

    def window(self, int64_t first, int64_t last):
        """Go forward to object `first`, to read up to `last` (exclusive) in order: boxes, and
        geometry where it is read with them."""
        self.boxes.window(first, last)
        if self.in_step:
            self.geometry.window(first, last)

    def pick(self, const int64_t[:, ::1] objects):
        """Go forward to objects, ranges of one each, whose geometry, materials and ids are read."""
        self.geometry.pick(objects)
        self.materials.pick(objects)
        self.ids.pick(objects)

    def counts(self):
        """Count the objects whose geometry was read since the last call."""
        records, self.records_read = self.records_read, 0
        return records + self.geometry.counts()
