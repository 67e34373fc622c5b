/* A system that refuses calls: the loader puts these functions in place of the C library's.
 *
 * Nothing is counted until `fault_arm` is called. From then on calls are counted by family, and the
 * n-th of one family, or each from the n-th on, fails with an errno, or is made short: a read or a
 * write of half of the bytes. Of reads that are under way together their queue fails, their begin, or
 * what is told of their end. Calls on standard streams are no part of it, and neither are
 * allocations below `LARGE` bytes: Python itself makes thousands of these. */

#define _GNU_SOURCE
#include <dlfcn.h>
#include <dirent.h>
#include <errno.h>
#include <fcntl.h>
#include <linux/aio_abi.h>
#include <pthread.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdio.h>
#include <stdlib.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <sys/statvfs.h>
#include <sys/syscall.h>
#include <sys/uio.h>
#include <unistd.h>

enum family {
    OPEN, READ, WRITE, SYNC, RENAME, REMOVE, MKDIR, STAT, SEEK, MAP, TRUNCATE, CLOSE, MEMORY,
    THREAD, AIO, FAMILIES
};

/* What `fault_arm` takes for an errno where a call is to be short. */
enum { SHORT = -1 };

enum { LARGE = 1 << 16 };

static int armed, wanted, number, lasting;
static long which;
static long counts[FAMILIES];

void fault_arm(int family, long n, int error, int every)
{
    for (int k = 0; k < FAMILIES; k++)
        counts[k] = 0;
    wanted = family, which = n, number = error, lasting = every;
    __atomic_store_n(&armed, 1, __ATOMIC_SEQ_CST);
}

void fault_disarm(void)
{
    __atomic_store_n(&armed, 0, __ATOMIC_SEQ_CST);
}

long fault_count(int family)
{
    return counts[family];
}

/* Count a call; tell whether it is one to fail, and set errno then. */
static int hit(enum family family)
{
    if (!__atomic_load_n(&armed, __ATOMIC_SEQ_CST))
        return 0;
    long n = __atomic_add_fetch(&counts[family], 1, __ATOMIC_SEQ_CST);
    if ((int)family != wanted || !(n == which || (lasting && n > which)))
        return 0;
    if (number != SHORT)
        errno = number;
    return 1;
}

static int hit_file(enum family family, int file)
{
    return (file < 0 || file > 2) && hit(family);
}

/* The C library's own function of a name. */
#define OWN(name, type)                                   \
    static __typeof__(type) own;                               \
    if (!own)                                             \
        own = (type)dlsym(RTLD_NEXT, name);

#define TAKES(...) __VA_ARGS__

/* A function that fails as its family does. */
#define WRAP(result, name, family, failure, parameters, arguments) \
    result name(parameters)                                        \
    {                                                              \
        OWN(#name, result (*)(parameters))                         \
        if (hit(family))                                           \
            return failure;                                        \
        return own(arguments);                                     \
    }

#define WRAP_FILE(result, name, family, failure, parameters, arguments) \
    result name(parameters)                                             \
    {                                                                   \
        OWN(#name, result (*)(parameters))                              \
        if (hit_file(family, file))                                     \
            return failure;                                             \
        return own(arguments);                                          \
    }

/* A transfer, which may be short too. */
#define WRAP_TRANSFER(name, family, parameters, arguments) \
    ssize_t name(parameters)                               \
    {                                                      \
        OWN(#name, ssize_t (*)(parameters))                \
        if (hit_file(family, file)) {                      \
            if (number != SHORT)                           \
                return -1;                                 \
            size = (size + 1) / 2;                         \
        }                                                  \
        return own(arguments);                             \
    }

/* A transfer of several buffers, of which a short one has the first. */
#define WRAP_VECTOR(name, family, parameters, arguments) \
    ssize_t name(parameters)                             \
    {                                                    \
        OWN(#name, ssize_t (*)(parameters))              \
        if (hit_file(family, file)) {                    \
            if (number != SHORT)                         \
                return -1;                               \
            struct iovec part = vectors[0];              \
            part.iov_len = (part.iov_len + 1) / 2;       \
            vectors = &part, many = 1;                   \
            return own(arguments);                       \
        }                                                \
        return own(arguments);                           \
    }

#define MODE_AFTER(flags)                                 \
    mode_t mode = 0;                                      \
    if (flags & (O_CREAT | __O_TMPFILE)) {                \
        va_list more;                                     \
        va_start(more, flags);                            \
        mode = va_arg(more, mode_t);                      \
        va_end(more);                                     \
    }

#define WRAP_OPEN(name)                                   \
    int name(const char *path, int flags, ...)            \
    {                                                     \
        MODE_AFTER(flags)                                 \
        OWN(#name, int (*)(const char *, int, ...))       \
        return hit(OPEN) ? -1 : own(path, flags, mode);   \
    }

#define WRAP_OPENAT(name)                                     \
    int name(int at, const char *path, int flags, ...)        \
    {                                                         \
        MODE_AFTER(flags)                                     \
        OWN(#name, int (*)(int, const char *, int, ...))      \
        return hit(OPEN) ? -1 : own(at, path, flags, mode);   \
    }

WRAP_OPEN(open)
WRAP_OPEN(open64)
WRAP_OPENAT(openat)
WRAP_OPENAT(openat64)
WRAP(FILE *, fopen, OPEN, NULL, TAKES(const char *path, const char *mode), TAKES(path, mode))
WRAP(FILE *, fopen64, OPEN, NULL, TAKES(const char *path, const char *mode), TAKES(path, mode))
WRAP(DIR *, opendir, OPEN, NULL, TAKES(const char *path), TAKES(path))
WRAP(DIR *, fdopendir, OPEN, NULL, TAKES(int file), TAKES(file))

WRAP_TRANSFER(read, READ, TAKES(int file, void *buffer, size_t size), TAKES(file, buffer, size))
WRAP_TRANSFER(pread, READ, TAKES(int file, void *buffer, size_t size, off_t at),
              TAKES(file, buffer, size, at))
WRAP_TRANSFER(pread64, READ, TAKES(int file, void *buffer, size_t size, off_t at),
              TAKES(file, buffer, size, at))
WRAP_VECTOR(readv, READ, TAKES(int file, const struct iovec *vectors, int many),
            TAKES(file, vectors, many))
WRAP_VECTOR(preadv2, READ,
            TAKES(int file, const struct iovec *vectors, int many, off_t at, int flags),
            TAKES(file, vectors, many, at, flags))
WRAP_VECTOR(preadv64v2, READ,
            TAKES(int file, const struct iovec *vectors, int many, off_t at, int flags),
            TAKES(file, vectors, many, at, flags))
WRAP_VECTOR(preadv, READ, TAKES(int file, const struct iovec *vectors, int many, off_t at),
            TAKES(file, vectors, many, at))
WRAP_VECTOR(preadv64, READ, TAKES(int file, const struct iovec *vectors, int many, off_t at),
            TAKES(file, vectors, many, at))

WRAP_TRANSFER(write, WRITE, TAKES(int file, const void *buffer, size_t size),
              TAKES(file, buffer, size))
WRAP_TRANSFER(pwrite, WRITE, TAKES(int file, const void *buffer, size_t size, off_t at),
              TAKES(file, buffer, size, at))
WRAP_TRANSFER(pwrite64, WRITE, TAKES(int file, const void *buffer, size_t size, off_t at),
              TAKES(file, buffer, size, at))
WRAP_VECTOR(writev, WRITE, TAKES(int file, const struct iovec *vectors, int many),
            TAKES(file, vectors, many))

WRAP(int, fsync, SYNC, -1, TAKES(int file), TAKES(file))
WRAP(int, fdatasync, SYNC, -1, TAKES(int file), TAKES(file))

WRAP(int, rename, RENAME, -1, TAKES(const char *from, const char *to), TAKES(from, to))
WRAP(int, renameat, RENAME, -1, TAKES(int at, const char *from, int there, const char *to),
     TAKES(at, from, there, to))
WRAP(int, renameat2, RENAME, -1,
     TAKES(int at, const char *from, int there, const char *to, unsigned flags),
     TAKES(at, from, there, to, flags))

WRAP(int, unlink, REMOVE, -1, TAKES(const char *path), TAKES(path))
WRAP(int, unlinkat, REMOVE, -1, TAKES(int at, const char *path, int flags),
     TAKES(at, path, flags))
WRAP(int, rmdir, REMOVE, -1, TAKES(const char *path), TAKES(path))
WRAP(int, mkdir, MKDIR, -1, TAKES(const char *path, mode_t mode), TAKES(path, mode))

WRAP(int, stat, STAT, -1, TAKES(const char *path, struct stat *found), TAKES(path, found))
WRAP(int, stat64, STAT, -1, TAKES(const char *path, struct stat64 *found), TAKES(path, found))
WRAP(int, lstat, STAT, -1, TAKES(const char *path, struct stat *found), TAKES(path, found))
WRAP(int, lstat64, STAT, -1, TAKES(const char *path, struct stat64 *found), TAKES(path, found))
WRAP_FILE(int, fstat, STAT, -1, TAKES(int file, struct stat *found), TAKES(file, found))
WRAP_FILE(int, fstat64, STAT, -1, TAKES(int file, struct stat64 *found), TAKES(file, found))
WRAP(int, fstatat, STAT, -1, TAKES(int at, const char *path, struct stat *found, int flags),
     TAKES(at, path, found, flags))
WRAP(int, fstatat64, STAT, -1, TAKES(int at, const char *path, struct stat64 *found, int flags),
     TAKES(at, path, found, flags))
WRAP(int, statx, STAT, -1,
     TAKES(int at, const char *path, int flags, unsigned mask, struct statx *found),
     TAKES(at, path, flags, mask, found))
WRAP(int, statvfs, STAT, -1, TAKES(const char *path, struct statvfs *found), TAKES(path, found))
WRAP(int, statvfs64, STAT, -1, TAKES(const char *path, struct statvfs64 *found),
     TAKES(path, found))
/* Of programs that were built with a C library before 2.33. */
WRAP(int, __xstat, STAT, -1, TAKES(int form, const char *path, struct stat *found),
     TAKES(form, path, found))
WRAP(int, __xstat64, STAT, -1, TAKES(int form, const char *path, struct stat64 *found),
     TAKES(form, path, found))
WRAP(int, __lxstat, STAT, -1, TAKES(int form, const char *path, struct stat *found),
     TAKES(form, path, found))
WRAP(int, __lxstat64, STAT, -1, TAKES(int form, const char *path, struct stat64 *found),
     TAKES(form, path, found))
WRAP_FILE(int, __fxstat, STAT, -1, TAKES(int form, int file, struct stat *found),
          TAKES(form, file, found))
WRAP_FILE(int, __fxstat64, STAT, -1, TAKES(int form, int file, struct stat64 *found),
          TAKES(form, file, found))
WRAP(int, __fxstatat, STAT, -1,
     TAKES(int form, int at, const char *path, struct stat *found, int flags),
     TAKES(form, at, path, found, flags))
WRAP(int, __fxstatat64, STAT, -1,
     TAKES(int form, int at, const char *path, struct stat64 *found, int flags),
     TAKES(form, at, path, found, flags))

WRAP_FILE(off_t, lseek, SEEK, -1, TAKES(int file, off_t at, int whence), TAKES(file, at, whence))
WRAP_FILE(off64_t, lseek64, SEEK, -1, TAKES(int file, off64_t at, int whence),
          TAKES(file, at, whence))

WRAP(void *, mmap, MAP, MAP_FAILED,
     TAKES(void *at, size_t size, int access, int flags, int file, off_t offset),
     TAKES(at, size, access, flags, file, offset))
WRAP(void *, mmap64, MAP, MAP_FAILED,
     TAKES(void *at, size_t size, int access, int flags, int file, off64_t offset),
     TAKES(at, size, access, flags, file, offset))

WRAP(int, ftruncate, TRUNCATE, -1, TAKES(int file, off_t size), TAKES(file, size))
WRAP(int, ftruncate64, TRUNCATE, -1, TAKES(int file, off64_t size), TAKES(file, size))
WRAP(int, truncate, TRUNCATE, -1, TAKES(const char *path, off_t size), TAKES(path, size))
WRAP(int, truncate64, TRUNCATE, -1, TAKES(const char *path, off64_t size), TAKES(path, size))
WRAP(int, fallocate, TRUNCATE, -1, TAKES(int file, int mode, off_t at, off_t size),
     TAKES(file, mode, at, size))
WRAP(int, posix_fallocate, TRUNCATE, number, TAKES(int file, off_t at, off_t size),
     TAKES(file, at, size))

/* A file whose close fails is closed all the same, as Linux does it. */
int close(int file)
{
    OWN("close", int (*)(int))
    int fails = hit_file(CLOSE, file), error = errno;
    int result = own(file);
    if (!fails)
        return result;
    errno = error;
    return -1;
}

int fclose(FILE *stream)
{
    OWN("fclose", int (*)(FILE *))
    int fails = hit_file(CLOSE, fileno(stream)), error = errno;
    int result = own(stream);
    if (!fails)
        return result;
    errno = error;
    return EOF;
}

/* Allocations. The C library's own are looked up before anything else can want memory. */
extern void *__libc_malloc(size_t), *__libc_calloc(size_t, size_t);
extern void *__libc_realloc(void *, size_t), *__libc_memalign(size_t, size_t);

static int no_room(size_t size)
{
    return size >= LARGE && hit(MEMORY);
}

void *malloc(size_t size)
{
    return no_room(size) ? NULL : __libc_malloc(size);
}

void *calloc(size_t many, size_t size)
{
    return no_room(many * size) ? NULL : __libc_calloc(many, size);
}

void *realloc(void *held, size_t size)
{
    return no_room(size) ? NULL : __libc_realloc(held, size);
}

void *aligned_alloc(size_t alignment, size_t size)
{
    return no_room(size) ? NULL : __libc_memalign(alignment, size);
}

int posix_memalign(void **held, size_t alignment, size_t size)
{
    if (no_room(size))
        return ENOMEM;
    *held = __libc_memalign(alignment, size);
    return *held ? 0 : ENOMEM;
}

int pthread_create(pthread_t *made, const pthread_attr_t *how, void *(*run)(void *), void *given)
{
    OWN("pthread_create",
        int (*)(pthread_t *, const pthread_attr_t *, void *(*)(void *), void *))
    return hit(THREAD) ? number : own(made, how, run, given);
}

/* What is told of reads that have ended: of the first that it failed, or got half of its bytes. */
static long ended_badly(long told, struct io_event *events)
{
    if (told > 0 && number == SHORT)
        events[0].res = (events[0].res + 1) / 2;
    else if (told > 0)
        events[0].res = -number;
    return told;
}

/* Reads that are under way together have no functions in the C library; names are exchanged past it. */
long syscall(long call, ...)
{
    OWN("syscall", long (*)(long, ...))
    long a[6];
    va_list given;
    va_start(given, call);
    for (int k = 0; k < 6; k++)
        a[k] = va_arg(given, long);
    va_end(given);
    if (call == SYS_renameat2 && hit(RENAME))
        return -1;
    int begins = call == SYS_io_setup || call == SYS_io_submit, ends = call == SYS_io_getevents;
    if (!(begins || ends) || !hit(AIO))
        return own(call, a[0], a[1], a[2], a[3], a[4], a[5]);
    if (ends && number != EINTR)
        return ended_badly(own(call, a[0], a[1], a[2], a[3], a[4]), (struct io_event *)a[3]);
    if (number == SHORT)
        errno = EAGAIN; /* there is no half of these */
    return -1;
}
