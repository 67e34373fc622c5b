"""Many pieces of files, read in few runs that are all under way together."""

from libc.stdint cimport int64_t

from bfrt.streams.reader cimport SharedFile

cdef enum:
    MOST_RUNS = 256

# A part of a file that is read at once, from a block's begin on, and where it comes to in memory.
cdef struct Run:
    void* file      # a SharedFile
    int64_t begin
    int64_t end
    int64_t at
    int64_t done    # bytes that are read


cdef class RunReader:
    cdef unsigned char* block
    cdef unsigned char* memory      # in it, from the begin of a block on
    cdef readonly int64_t capacity
    cdef int64_t used
    cdef int count
    cdef int under_way      # runs that the system reads
    cdef unsigned long queue    # where it keeps them; 0 for none
    cdef bint asked             # for one
    cdef Run runs[MOST_RUNS]

    cdef void clear(self) noexcept nogil
    cdef int64_t add(self, SharedFile file, int64_t begin, int64_t n) noexcept nogil
    cdef int read(self) except -1 nogil
    cdef void start(self) noexcept nogil
    cdef bint begin_run(self, SharedFile file, int k) noexcept nogil
    cdef int finish(self) except -1 nogil
