"""Files that exist whole or not at all.

A file is written under a temporary name in its own folder, opened exclusively, fsynced and
renamed. Whatever ends the work early, a full disk or Ctrl-C, takes the temporary file with it and
leaves what stood under the final name as it was. What a killed process left there, the next one
that writes into the folder removes.
"""

from __future__ import annotations

import contextlib
import errno
import io
import os
from collections.abc import Iterable, Iterator, Sequence
from functools import partial
from pathlib import Path

from bfrt.errors import SettingError, StreamError
from bfrt.paths import is_file, mode_at, path_of, walk, without_links
from bfrt.refusals import DISK_FULL, calling, closing, refused
from bfrt.streams.exchange import exchange
from bfrt.streams.litter import sweep
from bfrt.streams.ownership import Owned, create_file, create_folder
from bfrt.streams.removal import insist, remove_file

#: What it says where folders cannot be synced: some network file systems, and folders that one
#: may write to and not read.
UNSYNCED = (errno.EINVAL, errno.EBADF, errno.EACCES)

#: What it says where it has no files without a name, or has none in a folder's file system.
NAMED_ONLY = (errno.EISDIR, errno.ENOENT, errno.EOPNOTSUPP, errno.EINVAL)


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
    with atomic_paths([path]) as (temporary,):
        yield temporary


@contextlib.contextmanager
def atomic_paths(paths: Sequence[str | os.PathLike[str]]) -> Iterator[list[Path]]:
    """Give temporary paths to write to, as `atomic_path` does, of files that all exist or none.

    Where the last steps fail, names that files have got already go to what had them before, where
    the system can exchange names; else these files are removed.
    """
    with _written([_target(path) for path in paths]) as temporaries:
        yield temporaries


@contextlib.contextmanager
def _written(targets: Sequence[Path], mode: int = 0o666) -> Iterator[list[Path]]:
    owned: list[Owned] = []
    temporaries: list[Path] = []
    try:
        for target in targets:
            owned.append(_create(target, mode))
            temporaries.append(owned[-1].path)
        yield temporaries
        for temporary in temporaries:
            sync_file(temporary)
        _take_names(temporaries, targets)
    except BaseException as error:
        for temporary in temporaries:
            remove_file(temporary)
        # Some systems only find out at close that there was no room.
        if isinstance(error, OSError) and error.errno in DISK_FULL:
            raise refused(targets[0], 0, error, "writing") from error
        raise
    finally:
        for each in owned:
            each.release()
    for folder in {target.parent for target in targets}:
        sync_folder(folder)


@contextlib.contextmanager
def atomic_file(path: str | os.PathLike[str]) -> Iterator[io.FileIO]:
    """Give a file to write to, unbuffered, which becomes `path` when the block ends well.

    Its ``name`` is the temporary one. What the block raises, and what the system refuses, is as
    with `atomic_path`.
    """
    with atomic_path(path) as temporary, _opened(temporary, path) as file:
        yield file


@contextlib.contextmanager
def atomic_own_file(path: Path, mode: int = 0o666) -> Iterator[io.FileIO]:
    """Do as `atomic_file` for a file of ours, where a link is no wish: it is replaced."""
    with _written([path], mode) as (temporary,), _opened(temporary, path) as file:
        yield file


def write_parts(path: str | os.PathLike[str], parts: Iterable[bytes]) -> None:
    """Write a file of parts, whole or not at all, and look whether it has them all.

    Raises
    ------
    StreamError
        If the system refuses; `DiskFullError` where it has no room.
    """
    with atomic_path(path) as temporary:
        written = 0
        with _opened(temporary, path) as file:
            for part in parts:
                put(file, part, path)
                written += len(part)
        with calling(path, "examining"):
            found = temporary.stat().st_size
        if found != written:
            raise StreamError(path, found, errno.EIO, f"writing {written} bytes, of which it ends")


@contextlib.contextmanager
def _opened(temporary: Path, path: str | os.PathLike[str]) -> Iterator[io.FileIO]:
    """Open a temporary file to write to; `path` is what errors call it."""
    with calling(path, "opening"):
        opened = temporary.open("wb", buffering=0)
    with closing(opened, path) as file:
        yield file


def nameless(folder: Path, path: Path) -> io.FileIO:
    """Create a file in a folder, without a name that a crash could leave where the system can.

    Raises
    ------
    StreamError
        If the system refuses it; `path` is what the error calls it.
    """
    sweep(folder)
    try:
        descriptor = _unnamed(folder)
        if descriptor is None:
            owned = create_file(folder / "spool", 0o600)
            try:
                descriptor = os.dup(owned.descriptor)
            finally:
                owned.remove()
        return io.FileIO(descriptor, "r+")
    except OSError as error:
        raise refused(path, 0, error, "creating") from error


def _unnamed(folder: Path) -> int | None:
    """Return a descriptor of a new file without a name; None where the system has no such files."""
    if not hasattr(os, "O_TMPFILE"):
        return None
    try:
        return os.open(folder, os.O_TMPFILE | os.O_RDWR | os.O_CLOEXEC, 0o600)
    except OSError as error:
        if error.errno in NAMED_ONLY:
            return None
        raise


@contextlib.contextmanager
def temporary_folder(folder: Path, name: str) -> Iterator[Path]:
    """Create a folder in another, for us alone, which goes when the block ends.

    Parameters
    ----------
    name : str
        What its name, which nobody can foretell, begins with.
    """
    sweep(folder)
    try:
        owned = create_folder(folder / name, 0o700)
    except OSError as error:
        raise refused(folder / name, 0, error, "creating") from error
    try:
        yield owned.path
    finally:
        owned.remove()


@contextlib.contextmanager
def staged_paths(paths: Sequence[str | os.PathLike[str]]) -> Iterator[list[Path]]:
    """Give paths of files to make, which become `paths` when the block ends well: all or none.

    They have the suffixes of these, and lie in folders beside them that go when the block ends.
    What the block makes is whole and synced, as by `atomic_path`. Where the last steps fail, all
    is as with `atomic_paths`.
    """
    targets = [_target(path) for path in paths]
    parents = dict.fromkeys(target.parent for target in targets)
    with contextlib.ExitStack() as stack:
        aside = {each: stack.enter_context(temporary_folder(each, "files")) for each in parents}
        staged = [
            aside[target.parent] / f"{number}{target.suffix}"
            for number, target in enumerate(targets)
        ]
        yield staged
        _take_names(staged, targets)
    for parent in parents:
        sync_folder(parent)


def put(file: io.FileIO, data: bytes | memoryview, path: str | os.PathLike[str]) -> None:
    """Write all of `data` to the unbuffered `file`; raise `StreamError` if the system refuses."""
    left = memoryview(data).cast("B")
    try:
        while left:
            left = left[file.write(left) :]
    except OSError as error:
        raise refused(path, file.tell(), error, "writing") from error


def sync_file(path: Path) -> None:
    """Make a file's contents durable; `StreamError` if the system refuses."""
    _sync(path, os.O_RDWR)


def sync_folders(folder: Path) -> None:
    """Make the entries of a folder and of all below durable; `StreamError` as `sync_folder`."""
    with calling(folder, "listing"):
        for each, _, _ in walk(folder):
            sync_folder(each)


def sync_folder(folder: Path) -> None:
    """Make a folder's entries durable; `StreamError` if the system refuses."""
    if not hasattr(os, "O_DIRECTORY"):  # where a folder cannot be opened it need not be
        return
    try:
        _sync(folder, os.O_RDONLY)
    except StreamError as error:
        if error.errno not in UNSYNCED:
            raise


def _target(path: str | os.PathLike[str]) -> Path:
    """Return the file that a path stands for, a link's target."""
    target = without_links(path_of("output", path))
    if mode_at(target) and not is_file(target):
        raise SettingError(f"{path}: found something else than a file, expected a file or nothing")
    return target


def _take_names(temporaries: Sequence[Path], targets: Sequence[Path]) -> None:
    """Give files their names, all or none.

    Where one of several cannot get its name, the others have what was there before again: the
    two had changed places, if the system can do that.
    """
    if len(targets) == 1:
        _rename(temporaries[0], targets[0])
        return
    with calling(targets[0], "examining"):
        own = [path.stat() for path in temporaries]
    try:
        for temporary, target in zip(temporaries, targets, strict=True):
            _swap(temporary, target)
    except BaseException:
        _take_back(temporaries, targets, own)
        raise
    for replaced in temporaries:
        remove_file(replaced)


def _take_back(
    temporaries: Sequence[Path], targets: Sequence[Path], own: Sequence[os.stat_result]
) -> None:
    """Undo what `_take_names` did, but where all have their names: they are whole, and stay.

    Parameters
    ----------
    own : sequence of os.stat_result
        What tells the new files from those that were there.
    """
    named = [_is_at(target, facts) for target, facts in zip(targets, own, strict=True)]
    if all(named):
        return
    for temporary, target, has_name in zip(temporaries, targets, named, strict=True):
        if has_name and temporary.exists():
            insist(partial(exchange, temporary, target))
        elif has_name:
            remove_file(target)


def _is_at(path: Path, facts: os.stat_result) -> bool:
    """Tell whether a path is a file of which facts are known."""
    try:
        return os.path.samestat(path.lstat(), facts)
    except OSError:
        return False


def _create(target: Path, mode: int) -> Owned:
    """Create an empty file beside `target`, with the permissions that any new file gets."""
    sweep(target.parent)
    try:
        return create_file(target, mode)
    except OSError as error:
        raise refused(target, 0, error, "creating") from error


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
    with calling(target, "renaming to it"):
        temporary.replace(target)


def _swap(temporary: Path, target: Path) -> None:
    """Have a file change places with what has its name, or take the name where nothing has it."""
    with calling(target, "renaming to it"):
        changed = mode_at(target) and exchange(temporary, target)
    if not changed:
        _rename(temporary, target)
