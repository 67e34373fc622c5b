"""Cursors over materials."""

cimport cython
from libc.stdint cimport int64_t

from bfrt.scan.runs cimport prefetch_runs


@cython.final
cdef class MaterialCursor:
    """Reads the palette indices of a stream's objects, forwards.

    Parameters
    ----------
    stream : bfrt.store.store.Stream
        The stream to read.
    files : bfrt.scan.files.StreamFiles
        The open files.
    capacity : int
        Bytes of the read buffer.
    """

    def __cinit__(self, stream, files, size_t capacity):
        self.one = stream.material
        self.bytes = stream.material_bytes
        if self.bytes:
            self.reader = files.reader("materials", capacity)
        self.rewind()

    def rewind(self, bint prefetched=False):
        """Begin again at the first object."""
        if self.reader is not None:
            self.reader.rewind(prefetched)
        self.at = self.known = self.picking = 0

    def window(self, int64_t first, int64_t last):
        """Go forward to object `first`, to read up to `last` (exclusive)."""
        self.at = first
        self.known = 0
        if self.reader is not None:
            self.reader.window(first * self.bytes, last * self.bytes)

    def pick(self, const int64_t[:, ::1] objects):
        """Go forward to objects, ranges of one each, whose materials `pick_material` then gives."""
        self.window(objects[0, 0], objects[objects.shape[0] - 1, 1])
        self.objects = objects
        self.picking = 0
        if self.reader is not None:
            prefetch_runs(self.reader, objects, self.bytes)
