"""Forward-only buffered reading of fixed-size records, without the GIL.

Reads are large and ask the system for the next buffer ahead of time (``posix_fadvise`` where
there is one). A short read is not the end of the file, and an interrupted one is tried again.

A gap is read through where that is cheaper than to seek over it. After a seek reads begin small
and double while they go on, so that a lonely record does not cost a whole buffer; but where a
caller knows how far it reads (`read_ahead`), just that is read, at once. What is known before it is
needed is prefetched: many requests are then under way together, and the file is read by a second
descriptor, for which the system's own read-ahead is switched off.
"""

cimport cython
from cpython.mem cimport PyMem_RawFree, PyMem_RawMalloc
from libc.errno cimport EINTR, EINVAL, errno
from libc.stdint cimport int64_t, uintptr_t
from libc.string cimport memmove

import os

from bfrt.errors import ShortReadError, StreamError
from bfrt.refusals import give_up
from bfrt.streams.atomic cimport atomic_add, atomic_exchange

cdef extern from *:
    """
    #include <fcntl.h>
    #include <unistd.h>
    static inline void bfrt_no_read_ahead(int fd) {
    #ifdef POSIX_FADV_RANDOM
        (void)posix_fadvise(fd, 0, 0, POSIX_FADV_RANDOM);
    #else
        (void)fd;
    #endif
    }
    """
    void no_read_ahead "bfrt_no_read_ahead"(int fd) noexcept nogil
    ssize_t pread(int fd, void* buffer, size_t n, int64_t offset) noexcept nogil

cdef enum:
    PAGE = 4096
    MOST = 1 << 30  # bytes of one read: some systems refuse those of 2^31 and more
    GAP = 1 << 16   # bytes that are read through: a seek costs as much as 30 to 100 KB of reading
    PREFETCH_GAP = 1 << 14  # where many requests are under way, a request costs as much as so many

#: How files are opened.
FLAGS = os.O_RDONLY | getattr(os, "O_CLOEXEC", 0)

#: How they are opened past the system's cache; 0 where no file is.
DIRECT = getattr(os, "O_DIRECT", 0)


@cython.final
cdef class SharedFile:
    """Opens a file for readers.

    Parameters
    ----------
    path : path-like
        The file.
    prefetched : bool
        Whether it will be read where that is prefetched, too.
    opener : callable, optional
        Gives a descriptor for the path and flags, as for Python's own `open`.
    direct : bool
        Whether what is prefetched is read past the system's cache, where the file's system can.

    Raises
    ------
    StreamError
        If it cannot be opened.
    """

    def __cinit__(self, path, bint prefetched=False, opener=os.open, bint direct=False):
        self.fd = self.prefetch_fd = -1
        self.path = os.fspath(path)
        try:
            self.fd = opener(self.path, FLAGS)
            self.size = os.fstat(self.fd).st_size
            if prefetched and direct and DIRECT:
                self.open_direct(opener)
            if prefetched and not self.direct:
                self.prefetch_fd = opener(self.path, FLAGS)
            if prefetched:
                no_read_ahead(self.prefetch_fd)
        except OSError as error:
            raise StreamError(self.path, 0, error.errno, "opening") from None

    def __dealloc__(self):
        for fd in (self.fd, self.prefetch_fd):
            if fd >= 0:
                give_up(fd)

    def open_direct(self, opener):
        """Open the second descriptor past the system's cache, unless the file's system refuses."""
        try:
            self.prefetch_fd = opener(self.path, FLAGS | DIRECT)
        except OSError as error:
            if error.errno != EINVAL:
                raise
        else:
            self.direct = True

    def fileno(self):
        """Return the descriptor that is read in order."""
        return self.fd

    def counts(self):
        """Return the bytes read and the seeks since the last call, as a pair."""
        return atomic_exchange(&self.bytes_read, 0), atomic_exchange(&self.seeks, 0)


@cython.final
cdef class Reader:
    """Reads a window of a file, forwards.

    Parameters
    ----------
    file : SharedFile
        The file.
    capacity : int
        Bytes of the buffer, rounded up to pages: at least the largest record.
    sparse : bool
        Whether records are picked: reads then begin small after a seek. Otherwise each fills the
        buffer, as it should where everything is read.
    """

    def __cinit__(self, SharedFile file not None, size_t capacity, bint sparse=False):
        self.file = file
        self.fd = file.fd
        self.capacity = (capacity + PAGE - 1) // PAGE * PAGE
        self.gap = GAP
        self.least = self.span = min(self.capacity, <size_t>GAP) if sparse else self.capacity
        self.buffer = <unsigned char*>PyMem_RawMalloc(self.capacity)
        if self.buffer == NULL:
            raise MemoryError(f"a read buffer of {capacity} bytes")
        self.at = self.end = self.buffer

    def __dealloc__(self):
        PyMem_RawFree(self.buffer)

    def rewind(self, bint prefetched=False):
        """Begin a new sweep of the file, with an empty window at its start.

        Parameters
        ----------
        prefetched : bool
            Whether what is read is prefetched.
        """
        self.at = self.end = self.buffer
        self.position = self.stop = self.ahead = 0
        self.span = self.least
        self.expect(prefetched)

    cpdef int expect(self, bint prefetched) except -1:
        """Choose how the file is read from here: prefetched, or in order by read-ahead.

        Raises
        ------
        ValueError
            If the file was not opened to be prefetched.
        """
        if prefetched and self.file.prefetch_fd < 0:
            raise ValueError(f"{self.file.path}: found a file that is only read in order")
        self.gap = PREFETCH_GAP if prefetched else GAP
        self.fd = self.file.prefetch_fd if prefetched else self.file.fd
        return 0

    cpdef int window(self, int64_t begin, int64_t stop) except -1:
        """Go forward to `begin`, to read up to `stop` and not a byte beyond.

        Raises
        ------
        ValueError
            If that is backwards, or outside the file as it was opened.
        """
        cdef int64_t now = self.position - (self.end - self.at)
        if not now <= begin <= stop <= self.file.size:
            raise ValueError(
                f"{self.file.path}: window [{begin}, {stop}) from {now} of {self.file.size}: "
                "a reader goes forwards only, inside its file"
            )
        if begin <= self.position:
            self.at += begin - now
        else:
            self.jump(begin - now)
        self.stop = self.ahead = stop
        if self.position > stop:  # the last window had more: give it back
            self.end -= self.position - stop
            self.position = stop
        return 0

    def read(self, size_t n):
        """Return the next n bytes, as a copy."""
        return take(self, n)[:n]

    cdef int jump(self, int64_t n) except -1 nogil:
        """Leave the buffer behind."""
        self.position += n - (self.end - self.at)
        self.at = self.end = self.buffer
        self.span = self.least
        return 0

    cdef int pass_over(self, int64_t n) except -1 nogil:
        """Go beyond the buffer, inside the window."""
        cdef int64_t step
        if n - (self.end - self.at) > self.gap:
            return self.jump(n)
        while n > 0:
            if self.at == self.end:
                if self.position >= self.ahead:
                    return self.jump(n)
                self.refill(1)
                self.at -= 1
            step = min(n, <int64_t>(self.end - self.at))
            self.at += step
            n -= step
        return 0

    cdef void prefetch(self, int64_t begin, int64_t end) noexcept nogil:
        """Have the system begin to read the bytes [begin, end)."""
        will_need(self.fd, begin, end - begin)

    cdef const unsigned char* refill(self, size_t n) except NULL nogil:
        """Read until n bytes are there, and as many more as the buffer holds, up to `ahead`."""
        cdef size_t left = self.end - self.at
        cdef int64_t rest = self.stop - self.position
        cdef size_t room
        cdef const unsigned char* p
        if n > self.capacity or <int64_t>(n - left) > rest:
            with gil:
                raise ShortReadError(self.file.path, self.position - left, n, left + rest)
        memmove(self.buffer, self.at, left)
        self.at = self.buffer
        self.end = self.buffer + left
        rest = max(min(rest, self.ahead - self.position), <int64_t>(n - left))
        room = min(self.capacity - left, max(self.span, n - left))
        if <int64_t>room > rest:
            room = rest
        self.span = min(self.capacity, 2 * self.span)
        if self.file.last_end != self.position:
            atomic_add(&self.file.seeks, 1)
        while room > 0:
            room -= self.read_more(min(room, <size_t>MOST))
        rest = min(self.stop, self.ahead) - self.position
        if rest > 0 and self.span == self.capacity:
            will_need(self.fd, self.position, min(rest, <int64_t>self.capacity))
        p = self.at
        self.at += n
        return p

    cdef int read_more(self, size_t n) except -1 nogil:
        """Read once, n bytes at the most; return how many came."""
        cdef ssize_t got
        while True:
            got = pread(self.fd, <void*><uintptr_t>self.end, n, self.position)
            if got > 0:
                break
            if got < 0 and errno == EINTR:
                continue
            with gil:
                if got < 0:
                    raise StreamError(self.file.path, self.position, errno, "reading")
                raise ShortReadError(self.file.path, self.position, n, 0)
        self.end += got
        self.position += got
        self.file.last_end = self.position
        atomic_add(&self.file.bytes_read, got)
        return got
