"""Many pieces of files, read in few runs.

::

    pieces   |==|  |====|      |===|        added in the order in which they lie
    runs     |==========|      |===|        a short gap is read through
    memory   |..........|.|....|...|        each from the begin of a block on

Where a file is read past the system's cache (`SharedFile.direct`) blocks have to be whole.
"""

cimport cython
from libc.errno cimport EINTR, EINVAL, errno
from libc.stdint cimport int64_t, uintptr_t

from cpython.mem cimport PyMem_RawFree, PyMem_RawMalloc

from bfrt.streams.atomic cimport atomic_add
from bfrt.streams.reader cimport SharedFile, prefetch_bytes, through_the_cache

from bfrt.errors import ShortReadError, StreamError

cdef extern from *:
    """
    #include <stdint.h>
    #include <string.h>
    #include <unistd.h>

    typedef unsigned long bfrt_queue; /* the system's; 0 for none */

    #if defined(__linux__)
    #include <errno.h>
    #include <linux/aio_abi.h>
    #include <sys/syscall.h>

    static inline bfrt_queue bfrt_queue_of(int most)
    {
        aio_context_t queue = 0;
        return syscall(SYS_io_setup, most, &queue) == 0 ? queue : 0;
    }

    static inline void bfrt_end_queue(bfrt_queue queue)
    {
        if (queue)
            (void)syscall(SYS_io_destroy, queue);
    }

    /* Have a read begin; false if the system takes none. */
    static inline int bfrt_submit(bfrt_queue queue, int fd, void *to, int64_t n, int64_t from,
                                  int64_t which)
    {
        struct iocb one, *all = &one;
        memset(&one, 0, sizeof one);
        one.aio_lio_opcode = IOCB_CMD_PREAD;
        one.aio_fildes = (uint32_t)fd;
        one.aio_buf = (uintptr_t)to;
        one.aio_nbytes = (uint64_t)n;
        one.aio_offset = from;
        one.aio_data = (uint64_t)which;
        return syscall(SYS_io_submit, queue, 1, &all) == 1;
    }

    /* Wait for a read to end, and tell which, and how many bytes came; below 0 for none. */
    static inline int64_t bfrt_ended(bfrt_queue queue, int64_t *got)
    {
        struct io_event event;
        long n;
        do
            n = syscall(SYS_io_getevents, queue, 1, 1, &event, NULL);
        while (n == 0 || (n < 0 && errno == EINTR));
        *got = n == 1 ? event.res : 0;
        return n == 1 ? (int64_t)event.data : -1;
    }
    #else
    static inline bfrt_queue bfrt_queue_of(int most) { (void)most; return 0; }
    static inline void bfrt_end_queue(bfrt_queue queue) { (void)queue; }
    static inline int bfrt_submit(bfrt_queue queue, int fd, void *to, int64_t n, int64_t from,
                                  int64_t which)
    {
        (void)queue, (void)fd, (void)to, (void)n, (void)from, (void)which;
        return 0;
    }
    static inline int64_t bfrt_ended(bfrt_queue queue, int64_t *got)
    {
        (void)queue, (void)got;
        return -1;
    }
    #endif
    """
    unsigned long queue_of "bfrt_queue_of"(int most) noexcept nogil
    void end_queue "bfrt_end_queue"(unsigned long queue) noexcept nogil
    bint submit "bfrt_submit"(unsigned long queue, int fd, void* to, int64_t n, int64_t begin,
                              int64_t which) noexcept nogil
    int64_t ended "bfrt_ended"(unsigned long queue, int64_t* got) noexcept nogil
    ssize_t pread(int fd, void* buffer, size_t n, int64_t offset) noexcept nogil

cdef enum:
    BLOCK = 4096    # what is read past the cache begins and ends at multiples of so many bytes
    GAP = 12 << 10  # bytes that are read through: where many runs are under way, one costs as much


cdef inline int64_t block_of(int64_t n) noexcept nogil:
    return n & -BLOCK


cdef inline int64_t blocks_up(int64_t n) noexcept nogil:
    return (n + BLOCK - 1) & -BLOCK


@cython.final
cdef class RunReader:
    """Reads pieces of files into memory of its own.

    Parameters
    ----------
    capacity : int
        Bytes, rounded up to blocks. A piece of n bytes may take `RunReader.room(n)`.
    """

    def __cinit__(self, int64_t capacity):
        self.capacity = blocks_up(capacity)
        self.block = <unsigned char*>PyMem_RawMalloc(self.capacity + BLOCK)
        if self.block == NULL:
            raise MemoryError(f"{capacity} bytes to read to")
        self.memory = <unsigned char*>blocks_up(<uintptr_t>self.block)

    def __dealloc__(self):
        end_queue(self.queue)
        PyMem_RawFree(self.block)

    @staticmethod
    def room(int64_t n):
        """Return the bytes that a piece of n bytes takes at the most, wherever it lies."""
        return blocks_up(n) + 2 * BLOCK

    def take(self, pieces):
        """Read pieces of files; return the bytes of as many as there is room for.

        Parameters
        ----------
        pieces : list of (SharedFile, int, int)
            Files, where in them a piece begins, and its bytes.

        Raises
        ------
        ShortReadError
            If a file ends before its piece does.
        StreamError
            As the system refuses.
        """
        cdef list places = []
        cdef int64_t at
        self.clear()
        for file, begin, n in pieces:
            at = self.add(file, begin, n)
            if at < 0:
                break
            places.append((at, n))
        with nogil:
            self.read()
        return [bytes(self.memory[at:at + n]) for at, n in places]

    cdef void clear(self) noexcept nogil:
        """Begin with nothing."""
        self.used = 0
        self.count = 0

    cdef int64_t add(self, SharedFile file, int64_t begin, int64_t n) noexcept nogil:
        """Add a piece; return where in memory it will be, or -1 if there is no room for it."""
        cdef Run* run = &self.runs[max(self.count, 1) - 1]
        cdef int64_t end = begin + n
        cdef int64_t first = block_of(begin)
        if self.count and run.file == <void*>file and run.begin <= begin <= run.end + GAP:
            if run.at + blocks_up(max(end, run.end)) - run.begin > self.capacity:
                return -1
            run.end = max(end, run.end)
            self.used = run.at + blocks_up(run.end) - run.begin
            return run.at + begin - run.begin
        if self.count == MOST_RUNS or self.used + blocks_up(end) - first > self.capacity:
            return -1
        run = &self.runs[self.count]
        run.file, run.begin, run.end, run.at = <void*>file, first, end, self.used
        self.count += 1
        self.used += blocks_up(end) - first
        return run.at + begin - first

    cdef int read(self) except -1 nogil:
        """Read all pieces that were added."""
        self.start()
        return self.finish()

    cdef void start(self) noexcept nogil:
        """Have the system begin to read all of them."""
        cdef Run* run
        cdef int k
        for k in range(self.count):
            run = &self.runs[k]
            run.done = 0
            if self.count > 1:
                self.under_way += self.begin_run(<SharedFile>run.file, k)

    cdef bint begin_run(self, SharedFile file, int k) noexcept nogil:
        """Have the system begin to read a run; false if that is for `read_rest`."""
        cdef Run* run = &self.runs[k]
        if not file.direct:
            prefetch_bytes(file, run.begin, run.end - run.begin)
            return False
        if not self.asked:
            self.queue, self.asked = queue_of(MOST_RUNS), True
        return self.queue != 0 and submit(
            self.queue, file.prefetch_fd, self.memory + run.at, blocks_up(run.end) - run.begin,
            run.begin, k,
        )

    cdef int finish(self) except -1 nogil:
        """Wait until they are read."""
        cdef int64_t got = 0, which
        cdef int k
        while self.under_way:
            which = ended(self.queue, &got)
            if which < 0:   # it tells no more: all ends with the queue, and is read again
                end_queue(self.queue)
                self.queue, self.under_way = 0, 0
                break
            self.under_way -= 1
            self.runs[which].done = max(got, 0)   # what failed is read again, and told
        for k in range(self.count):
            read_rest(<SharedFile>self.runs[k].file, &self.runs[k], self.memory)
        return 0


cdef int read_rest(SharedFile file, const Run* run, unsigned char* memory) except -1 nogil:
    """Read what is missing of a run."""
    cdef int64_t n = run.end - run.begin, done = run.done
    cdef int64_t whole = blocks_up(n) if file.direct else n
    cdef ssize_t got
    cdef bint direct
    atomic_add(&file.seeks, file.last_end != run.begin)
    while done < n:
        direct = file.direct    # before the read: other threads may switch it off meanwhile
        got = pread(file.prefetch_fd, memory + run.at + done, whole - done, run.begin + done)
        if got > 0:
            done += got
        elif got == 0:
            with gil:
                raise ShortReadError(file.path, run.begin + done, n - done, 0)
        elif errno == EINVAL and direct:    # as after a read that ended within a block
            through_the_cache(file)
        elif errno != EINTR:
            with gil:
                raise StreamError(file.path, run.begin + done, errno, "reading")
    file.last_end = blocks_up(run.end)
    atomic_add(&file.bytes_read, n)
    return 0
