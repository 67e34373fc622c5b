"""A system that refuses reads and writes: at the first, at the second, and so on.

Reads that a library makes itself, not through Python, are refused by a function of C that the
system's loader puts in place of its own.
"""

from __future__ import annotations

import errno
import io
import itertools
import os
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from bfrt.errors import DiskFullError, StreamError
from bfrt.formats import source as source_module


class Broken(io.FileIO):
    """A file whose later reads the system refuses."""

    reads = 0

    def readinto(self, buffer):
        Broken.reads -= 1
        if Broken.reads < 0:
            raise OSError(errno.EIO, os.strerror(errno.EIO))
        return super().readinto(buffer)


def alone(file: Path) -> None:
    """Nothing is beside a file."""
    assert [path.name for path in file.parent.iterdir()] == [file.name]


def refuse_reads(
    patch: pytest.MonkeyPatch, file: Path, work: Callable[[], object], check: Callable[[], None]
) -> int:
    """Do `work` again and again, until none of the reads of `file` that it needs is refused.

    Each refusal is one error with its place, after which `check` is called. Returns the reads.
    """
    patch.setattr(source_module.io, "FileIO", Broken)
    for reads in itertools.count():
        Broken.reads = reads
        try:
            work()
            return reads
        except StreamError as error:
            assert error.errno == errno.EIO
            assert str(error).startswith(f"{file}: reading at byte ")
        check()
    raise AssertionError


def refuse_writes(
    patch: pytest.MonkeyPatch, work: Callable[[], object], check: Callable[[], None]
) -> int:
    """Do `work` again and again, until the disk is full at none of its writes.

    Each time is one error, after which `check` is called. Returns the writes.
    """
    write = os.write
    for refused in itertools.count():
        calls = itertools.count()

        def full(*arguments, calls=calls, refused=refused):
            if next(calls) == refused:
                raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
            return write(*arguments)

        with patch.context() as now:
            now.setattr(os, "write", full)
            try:
                work()
                return refused
            except DiskFullError as error:
                assert "writing at byte" in str(error)
        check()
    raise AssertionError


#: Of reads of one file, the first `allowed` are made and all others refused.
REFUSING = r"""
#define _GNU_SOURCE
#include <dlfcn.h>
#include <errno.h>
#include <string.h>
#include <stdlib.h>
#include <sys/types.h>
#include <unistd.h>

int allowed = -1;
char refused[4096];

/* A process that another starts is told by its environment. */
__attribute__((constructor)) static void begin(void)
{
    const char *number = getenv("ALLOWED_READS"), *file = getenv("REFUSED_FILE");
    if (number && file) {
        allowed = atoi(number);
        strncpy(refused, file, sizeof refused - 1);
    }
}

static int is_refused(int file)
{
    char link[] = "/proc/self/fd/##########", path[4096];
    char *digit = link + 14;
    if (allowed < 0)
        return 0;
    for (int scale = 1000000000; scale; scale /= 10)
        if (file >= scale || scale == 1)
            *digit++ = '0' + file / scale % 10;
    *digit = 0;
    ssize_t size = readlink(link, path, sizeof path - 1);
    path[size > 0 ? size : 0] = 0;
    return !strcmp(path, refused) && !(allowed && allowed--);
}

ssize_t pread64(int file, void *buffer, size_t size, off_t offset)
{
    static ssize_t (*own)(int, void *, size_t, off_t);
    if (!own)
        own = (ssize_t (*)(int, void *, size_t, off_t))dlsym(RTLD_NEXT, "pread64");
    if (is_refused(file)) {
        errno = EIO;
        return -1;
    }
    return own(file, buffer, size, offset);
}

ssize_t pread(int file, void *buffer, size_t size, off_t offset)
{
    return pread64(file, buffer, size, offset);
}
"""

#: Work is done again and again, until no read of the file is refused.
AGAIN = """
import ctypes, errno, itertools, os, sys
from pathlib import Path
import bfrt

library, refused, source, settings = sys.argv[1:]
reads = ctypes.CDLL(library)
allowed = ctypes.c_int.in_dll(reads, "allowed")
(ctypes.c_char * 4096).in_dll(reads, "refused").value = os.fsencode(refused)
os.environ["REFUSED_FILE"] = refused
there = sorted(Path(source).parent.iterdir())
for allowed_now in itertools.count():
    allowed.value = allowed_now
    os.environ["ALLOWED_READS"] = str(allowed_now)
    try:
        bfrt.convert(source, source + ".bfrt", durable=False, **eval(settings))
        break
    except bfrt.StreamError as error:
        allowed.value = -1
        assert error.errno == errno.EIO, error
        assert str(error).startswith(refused + ": reading at byte "), error
        assert "\\n" not in str(error), error
        assert sorted(Path(source).parent.iterdir()) == there
print(allowed_now)
"""


def refuse_native_reads(folder: Path, source: Path, refused: Path, **settings: object) -> int:
    """Convert a file again and again, until none of the reads of `refused` that a library makes
    itself is refused: each refusal is one error with its place, and leaves nothing. Returns the
    reads. `folder` is where what does it is made."""
    compiler = shutil.which("cc")
    if compiler is None or not sys.platform.startswith("linux"):
        pytest.skip("there is no C compiler, or another system's loader")
    code, library = folder / "refusing.c", folder / "refusing.so"
    code.write_text(REFUSING)
    subprocess.run([compiler, "-shared", "-fPIC", "-o", library, code, "-ldl"], check=True)
    work = [sys.executable, "-c", AGAIN, *map(str, (library, refused, source)), repr(settings)]
    child = {**os.environ, "LD_PRELOAD": str(library)}
    ended = subprocess.run(work, env=child, cwd=folder, capture_output=True, text=True)
    assert ended.returncode == 0, ended.stderr
    return int(ended.stdout)
