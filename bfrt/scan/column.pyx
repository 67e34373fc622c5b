"""Cursors over columns."""

cimport cython
from libc.stdint cimport int64_t, uint64_t

from bfrt.scan.runs cimport prefetch_runs


@cython.final
cdef class ColumnCursor:
    """Reads one number for each object of a stream, forwards.

    Parameters
    ----------
    files : bfrt.scan.files.StreamFiles
        The open files.
    name : str
        The column's file.
    bytes : int
        Bytes of a number: 1, 2, 4 or 8; 0 where there is no file.
    capacity : int
        Bytes of the read buffer.
    one : int, optional
        The number of all objects where there is no file; without it, each object's is its place.
    base : int
        What is added to each number that is stored, or is that of all.
    """

    def __cinit__(self, files, name, int bytes, size_t capacity, one=None, uint64_t base=0):
        self.bytes = bytes
        self.placed = one is None
        self.base = base
        self.one = 0 if one is None else base + one
        if bytes:
            self.reader = files.reader(name, capacity)
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
        """Go forward to objects, ranges of one each, whose numbers `pick_number` then gives."""
        self.window(objects[0, 0], objects[objects.shape[0] - 1, 1])
        self.objects = objects
        self.picking = 0
        if self.reader is not None:
            prefetch_runs(self.reader, objects, self.bytes)
