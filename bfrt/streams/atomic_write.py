"""Files that exist whole or not at all.

A file is written under a temporary name in its own folder, opened exclusively, fsynced and
renamed. Whatever ends the work early, a full disk or Ctrl-C, takes the temporary file with it and
leaves what stood under the final name as it was.
"""

from __future__ import annotations

import contextlib
import errno
import io
import os
import secrets
import tempfile
from collections.abc import Iterator
from pathlib import Path

from bfrt.errors import DiskFullError, SettingError, StreamError

#: What the system says when there is no room: the disk's, and the user's where there are quotas.
DISK_FULL = tuple(getattr(errno, name) for name in ("ENOSPC", "EDQUOT") if hasattr(errno, name))


#: What it says where folders cannot be synced: some network file systems, and folders that one
#: may write to and not read.
UNSYNCED = (errno.EINVAL, errno.EBADF, errno.EACCES)


@contextlib.contextmanager
def atomic_path(path: str | os.PathLike[str]) -> Iterator[Path]:
    """Give a temporary path to write to, which becomes `path` when the block ends well.

    Parameters
    ----------
    path : path
        The file to make or to replace. A link is followed: its target is replaced, not the link.

    Yields
    ------
    pathlib.Path
        An empty file in the same folder. The block may reopen it by name, and must have closed it
        when it ends.

    Raises
    ------
    SettingError
        If `path` is there and is no regular file (a folder, a device).
    StreamError
        If the system refuses to create, sync or rename; `DiskFullError` where it has no room.
    """
    target = Path(os.path.realpath(path))
    if target.exists() and not target.is_file():
        raise SettingError(f"{path}: found something else than a file, expected a file or nothing")
    temporary = _create(target)
    try:
        yield temporary
        _sync(temporary, os.O_RDWR)
        _rename(temporary, target)
    except BaseException as error:
        with contextlib.suppress(OSError):  # the first error is the one to hear about
            temporary.unlink()
        # Some systems only find out at close that there was no room.
        if isinstance(error, OSError) and error.errno in DISK_FULL:
            raise refused(target, 0, error, "writing") from error
        raise
    sync_folder(target.parent)


def nameless(folder: Path, path: Path) -> io.FileIO:
    """Create a file in a folder, without a name that a crash could leave where the system can.

    Raises
    ------
    StreamError
        If the system refuses it; `path` is what the error calls it.
    """
    try:
        return tempfile.TemporaryFile(buffering=0, prefix="bfrt-", dir=folder)
    except OSError as error:
        raise refused(path, 0, error, "creating") from error


def put(file: io.FileIO, data: bytes | memoryview, path: str | os.PathLike[str]) -> None:
    """Write all of `data` to the unbuffered `file`; raise `StreamError` if the system refuses."""
    left = memoryview(data).cast("B")
    try:
        while left:
            left = left[file.write(left) :]
    except OSError as error:
        raise refused(path, file.tell(), error, "writing") from error


def sync_folder(folder: Path) -> None:
    """Make a folder's entries durable; `StreamError` if the system refuses."""
    if not hasattr(os, "O_DIRECTORY"):  # where a folder cannot be opened it need not be
        return
    try:
        _sync(folder, os.O_RDONLY)
    except StreamError as error:
        if error.errno not in UNSYNCED:
            raise


def refused(path: str | os.PathLike[str], offset: int, error: OSError, doing: str) -> StreamError:
    """Return a `StreamError` or `DiskFullError` for a system error; a StreamError stays itself."""
    if isinstance(error, StreamError):
        return error
    number = error.errno or errno.EIO
    kind = DiskFullError if number in DISK_FULL else StreamError
    return kind(path, offset, number, doing)


def _create(target: Path) -> Path:
    """Create an empty file beside `target`, with the permissions that any new file gets."""
    # 40 characters are at most 160 bytes, which leaves the name below every system's 255.
    temporary = target.with_name(f".{target.name[:40]}.{secrets.token_hex(8)}.tmp")
    try:
        os.close(os.open(temporary, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o666))
    except OSError as error:
        raise refused(target, 0, error, "creating") from error
    return temporary


def _sync(path: Path, flags: int) -> None:
    try:
        descriptor = os.open(path, flags)
        try:
            os.fsync(descriptor)
        finally:
            os.close(descriptor)
    except OSError as error:
        raise refused(path, 0, error, "syncing") from error


def _rename(temporary: Path, target: Path) -> None:
    try:
        temporary.replace(target)
    except OSError as error:
        raise refused(target, 0, error, "renaming to it") from error
