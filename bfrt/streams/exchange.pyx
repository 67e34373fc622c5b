"""Two names of one file system that change places in one step, where the system has one."""

import errno
import os

cdef extern from *:
    """
    #include <errno.h>
    #include <stdio.h>
    #ifdef __linux__
    #include <fcntl.h>
    #include <sys/syscall.h>
    #include <unistd.h>
    #endif
    static int bfrt_exchange(const char *one, const char *other) {
    #if defined(__APPLE__) && defined(RENAME_SWAP)
        return renamex_np(one, other, RENAME_SWAP) ? errno : 0;
    #elif defined(__linux__) && defined(SYS_renameat2)
        return syscall(SYS_renameat2, AT_FDCWD, one, AT_FDCWD, other, 2u) ? errno : 0;
    #else
        (void)one;
        (void)other;
        return ENOSYS;
    #endif
    }
    """
    int exchanged "bfrt_exchange"(const char* one, const char* other) noexcept nogil

#: What the system says where it, or the file system, has no such step.
UNKNOWN = (errno.ENOSYS, errno.EINVAL, errno.ENOTSUP)


def exchange(one, other):
    """Have two paths change places.

    Parameters
    ----------
    one, other : path-like
        Both are there, in one file system.

    Returns
    -------
    bool
        Whether they did; False where the system, or its file system, has no such step.

    Raises
    ------
    OSError
        As the system refuses.
    """
    cdef bytes first = os.fsencode(one)
    cdef bytes second = os.fsencode(other)
    cdef const char* a = first
    cdef const char* b = second
    cdef int refusal
    with nogil:
        refusal = exchanged(a, b)
    if refusal and refusal not in UNKNOWN:
        raise OSError(refusal, os.strerror(refusal), os.fsdecode(one), None, os.fsdecode(other))
    return not refusal
