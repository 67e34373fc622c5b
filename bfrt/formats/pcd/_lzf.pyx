"""What LibLZF has packed, unpacked forwards, without the GIL.

::

    000ccccc, c + 1 bytes                   bytes as they are
    cccooooo oooooooo                       c + 2 bytes from o + 1 before, for c of 1 to 6
    111ooooo cccccccc oooooooo              c + 9 bytes from there
"""

cimport cython
from libc.string cimport memcpy, memmove

cdef enum:
    HISTORY = 8192  # bytes that a reference may go back
    LONGEST = 264  # bytes that one instruction makes
    HELD = HISTORY + (1 << 16)
    PIECE = 1 << 16  # bytes that are fed at once
    INSTRUCTION = 33  # bytes of one, at the most
    LITERALS = 32  # instructions below are of bytes as they are

FEED_BYTES = PIECE


@cython.final
cdef class Unpacker:
    """Unpacks what comes piece by piece.

    Attributes
    ----------
    failed : bool
        Whether an instruction refers to bytes before the first.
    """

    cdef readonly bint failed
    cdef unsigned char packed[PIECE + INSTRUCTION]
    cdef unsigned char held[HELD]
    cdef Py_ssize_t at  # in what is packed
    cdef Py_ssize_t end
    cdef Py_ssize_t made  # in what is held: bytes that were made, and those that were taken
    cdef Py_ssize_t taken

    def __init__(self):
        self.failed = False
        self.at = self.end = self.made = self.taken = 0

    def feed(self, bytes piece not None):
        """Give the next packed bytes, `FEED_BYTES` at the most, when `take` returned none."""
        cdef Py_ssize_t left = self.end - self.at
        cdef const unsigned char *begin = piece
        if len(piece) > PIECE or left > INSTRUCTION:
            raise ValueError("more than there is room for")
        memmove(self.packed, self.packed + self.at, left)
        memcpy(self.packed + left, begin, len(piece))
        self.at, self.end = 0, left + len(piece)

    def take(self, unsigned char[::1] out not None):
        """Fill a buffer with the next bytes, or a part of it; return how many: 0 to be fed."""
        cdef Py_ssize_t count
        if self.taken == self.made:
            with nogil:
                self.run()
        count = min(self.made - self.taken, out.shape[0])
        if count:
            memcpy(&out[0], self.held + self.taken, count)
        self.taken += count
        return count

    cdef void run(self) noexcept nogil:
        """Follow instructions as long as there are whole ones, and room."""
        if self.made > HISTORY:
            memmove(self.held, self.held + self.made - HISTORY, HISTORY)
            self.made = self.taken = HISTORY
        while self.made + LONGEST <= HELD and not self.failed:
            if not self.follow():
                break

    cdef bint follow(self) noexcept nogil:
        """Follow an instruction, if all of it is there."""
        cdef const unsigned char *at = self.packed + self.at
        cdef Py_ssize_t left = self.end - self.at
        cdef Py_ssize_t count, back, size
        cdef unsigned char *to = self.held + self.made
        if left < 1 or left < self.size_of(at):
            return False
        size = self.size_of(at)
        if at[0] < LITERALS:
            count = at[0] + 1
            memcpy(to, at + 1, count)
        else:
            count = (at[0] >> 5) + 2 + (at[1] if size == 3 else 0)
            back = ((at[0] & 31) << 8 | at[size - 1]) + 1
            if back > self.made:
                self.failed = True
                return False
            self.copy(to, back, count)
        self.at += size
        self.made += count
        return True

    cdef Py_ssize_t size_of(self, const unsigned char *at) noexcept nogil:
        """Return the bytes of an instruction by its first."""
        return at[0] + 2 if at[0] < LITERALS else 3 if at[0] >> 5 == 7 else 2

    cdef void copy(self, unsigned char *to, Py_ssize_t back, Py_ssize_t count) noexcept nogil:
        """Copy bytes from `back` before, which may be those that are copied."""
        cdef Py_ssize_t i
        if back >= count:
            memcpy(to, to - back, count)
        else:
            for i in range(count):
                to[i] = (to - back)[i]
