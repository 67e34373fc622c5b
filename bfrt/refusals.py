"""What the system refuses, as errors of ours: files by their place, memory by what was asked."""

from __future__ import annotations

import contextlib
import errno
import mmap
import os
from collections.abc import Iterator
from typing import IO, Any, TypeVar

from bfrt.errors import BfrtError, DiskFullError, ResourceError, StreamError

#: What the system says when there is no room: the disk's, and the user's where there are quotas.
DISK_FULL = tuple(getattr(errno, name) for name in ("ENOSPC", "EDQUOT") if hasattr(errno, name))

#: What an error of memory ends with.
EXPECTED = "expected the system to have it (see ulimit -v, ulimit -d, and a container's limit)"

File = TypeVar("File", bound=IO[Any])


def refused(path: str | os.PathLike[str], offset: int, error: OSError, doing: str) -> StreamError:
    """Return a `StreamError` or `DiskFullError` for a system error; a StreamError stays itself."""
    if isinstance(error, StreamError):
        return error
    number = error.errno or errno.EIO
    kind = DiskFullError if number in DISK_FULL else StreamError
    return kind(path, offset, number, doing)


@contextlib.contextmanager
def calling(path: str | os.PathLike[str], doing: str, offset: int = 0) -> Iterator[None]:
    """Have the system's refusals in a block be ours, as `refused` makes them.

    Nothing of a caller's belongs into the block: what it raises is its own.
    """
    try:
        yield
    except OSError as error:
        raise refused(path, offset, error, doing) from error


@contextlib.contextmanager
def closing(file: File, path: str | os.PathLike[str]) -> Iterator[File]:
    """Yield a file that is open, and close it, which may be refused too."""
    try:
        yield file
    finally:
        with calling(path, "closing"):
            file.close()


def give_up(file: IO[Any] | int) -> None:
    """Close a file whose contents nobody needs any more: a refusal says nothing."""
    with contextlib.suppress(OSError):
        if isinstance(file, int):
            os.close(file)
        else:
            file.close()


def buffer_of(size: int) -> mmap.mmap:
    """Return memory of `size` bytes that takes room as it fills.

    Raises
    ------
    ResourceError
        If the system has none.
    """
    try:
        return mmap.mmap(-1, size)
    except OSError as error:
        asked = f"a buffer of {size} bytes"
        raise ResourceError(f"memory: found no room for {asked}, {EXPECTED}") from error


@contextlib.contextmanager
def in_memory(work: str, budget: int | None = None) -> Iterator[None]:
    """Have a lack of memory in a block be ours, with what is done and what was asked for.

    Parameters
    ----------
    work : str
        What the message begins with.
    budget : int, optional
        Bytes of the memory budget that the work has.
    """
    try:
        yield
    except BfrtError:
        raise
    except MemoryError as error:
        # NumPy and our kernels say what they asked for; Python itself says nothing.
        asked = " ".join(str(error).split()) or "one more object"
        inside = "" if budget is None else f" inside a budget of {budget >> 20}MiB"
        raise ResourceError(f"{work}: found no memory{inside} for {asked}, {EXPECTED}") from error
