"""The order in which objects were given."""

cimport cython
from libc.errno cimport EINTR, EIO, errno
from libc.stdint cimport int64_t, uint32_t, uint64_t

import numpy as np

from bfrt.errors import StreamError

cdef extern from "unistd.h" nogil:
    ssize_t pread(int fd, void* buffer, size_t n, int64_t offset)


@cython.final
cdef class GivenOrder:
    """Tells which object was given before another.

    Parameters
    ----------
    streams : sequence of bfrt.store.store.Stream
        All of a store's.
    """

    def __cinit__(self, streams):
        cdef int number, last = max((stream.number for stream in streams), default=0)
        self.files = []
        self.fd = np.full(last + 1, -1, np.intc)
        self.bytes = np.zeros(last + 1, np.intc)
        for stream in streams:
            if stream.ordered:
                file = stream.opened("ids")
                number = stream.number
                self.files.append(file)
                self.fd[number] = file.fileno()
                self.bytes[number] = stream.id_bytes

    cdef int64_t given_place(self, uint64_t id) noexcept nogil:
        """Read the place that an object had; 0, and `failed` is set, if that cannot be read."""
        cdef uint64_t stream = id >> INDEX_BITS
        cdef uint64_t at = id & ((<uint64_t>1 << INDEX_BITS) - 1)
        cdef int n = self.bytes[stream]
        cdef uint32_t short = 0
        cdef uint64_t long = 0
        cdef ssize_t got
        while True:
            got = pread(
                self.fd[stream], <void*>&short if n == 4 else <void*>&long, n, <int64_t>(at * n)
            )
            if got == n:
                return short if n == 4 else <int64_t>long
            if got < 0 and errno == EINTR:
                continue
            self.failed = errno if got < 0 else EIO
            return 0

    def check(self):
        """Raise what a read has failed with.

        Raises
        ------
        StreamError
            If one has.
        """
        if self.failed:
            raise StreamError(self.files[0].path, 0, self.failed, "reading")
