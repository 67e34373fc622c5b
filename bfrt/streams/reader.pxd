"""The forward-only reader: an inline fast half here, a raising half in reader.pyx.

::

    file    |.......|=========window=========|......|
                          |at....end|               take(n) gives n bytes at `at`
                          |buffer...........|       refill() goes on reading at `position`
"""

from libc.stdint cimport int64_t


cdef class SharedFile:
    """Holds an open file that several readers share, and counts what they read."""

    cdef readonly object path
    cdef readonly int64_t size
    cdef int fd
    cdef int prefetch_fd   # the same, without the system's own read-ahead
    cdef bint direct       # whether that one is read past the system's cache, in whole pages
    cdef int64_t last_end
    cdef int64_t bytes_read
    cdef int64_t seeks


cdef extern from *:
    """
    #include <fcntl.h>
    static inline void bfrt_will_need(int fd, int64_t offset, int64_t n) {
    #ifdef POSIX_FADV_WILLNEED
        (void)posix_fadvise(fd, offset, n, POSIX_FADV_WILLNEED);
    #else
        (void)fd; (void)offset; (void)n; /* the system's own read-ahead has to do */
    #endif
    }

    /* Have a file read through the system's cache from now on. */
    static inline void bfrt_cached(int fd) {
    #ifdef O_DIRECT
        int flags = fcntl(fd, F_GETFL);
        if (flags != -1)
            (void)fcntl(fd, F_SETFL, flags & ~O_DIRECT);
    #else
        (void)fd;
    #endif
    }
    """
    void will_need "bfrt_will_need"(int fd, int64_t offset, int64_t n) noexcept nogil
    void cached "bfrt_cached"(int fd) noexcept nogil


cdef inline void prefetch_bytes(SharedFile file, int64_t offset, int64_t n) noexcept nogil:
    """Have the system begin to read bytes of a file."""
    will_need(file.prefetch_fd, offset, n)


cdef inline void through_the_cache(SharedFile file) noexcept nogil:
    """Read a file as others are, though it was opened to be read past the system's cache."""
    cached(file.prefetch_fd)
    file.direct = False


cdef class Reader:
    cdef const unsigned char* at
    cdef const unsigned char* end
    cdef unsigned char* buffer
    cdef size_t capacity
    cdef int64_t gap       # bytes that are read through
    cdef size_t least      # bytes of a read after a jump
    cdef size_t span       # bytes of the next read: twice the last, up to the capacity
    cdef int64_t position
    cdef int64_t stop
    cdef int64_t ahead     # reads end here, where so much of the window is known to be needed
    cdef int fd            # of the file's, the one that is read
    cdef readonly SharedFile file

    cpdef int expect(self, bint prefetched) except -1
    cpdef int window(self, int64_t begin, int64_t stop) except -1
    cdef const unsigned char* refill(self, size_t n) except NULL nogil
    cdef int read_more(self, size_t n) except -1 nogil
    cdef int jump(self, int64_t n) except -1 nogil
    cdef int pass_over(self, int64_t n) except -1 nogil
    cdef void prefetch(self, int64_t begin, int64_t end) noexcept nogil


cdef inline void read_ahead(Reader r, int64_t end) noexcept nogil:
    """Have reads end there, and begin with a whole buffer: all up to it is needed."""
    r.ahead = end
    r.span = r.capacity


cdef inline const unsigned char* take(Reader r, size_t n) except NULL nogil:
    """Return the next n bytes, which stay in place until the next take."""
    cdef const unsigned char* p = r.at
    if <size_t>(r.end - p) >= n:
        r.at = p + n
        return p
    return r.refill(n)


cdef inline int skip(Reader r, int64_t n) except -1 nogil:
    """Go n bytes forward: a short way by reading on, a long one by a seek."""
    if n <= r.end - r.at:
        r.at += n
        return 0
    return r.pass_over(n)
