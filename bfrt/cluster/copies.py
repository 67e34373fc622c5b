"""Copies of stores on workers' own disks, for machines that share none, or a slow one."""

from __future__ import annotations

import fcntl
import os
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from io import FileIO
from pathlib import Path

from bfrt.errors import BfrtError, SettingError
from bfrt.grid.marks import verify_marks
from bfrt.paths import HEADER, header_at, is_file, is_folder, is_there
from bfrt.refusals import calling, closing, give_up, in_memory
from bfrt.store.atomic_folder import AtomicFolder
from bfrt.store.store import MADE, Store, open_store
from bfrt.store.writer import check_new_store
from bfrt.streams.atomic_write import put, sync_file
from bfrt.streams.ownership import LOCKLESS

#: Bytes that are copied at once.
BLOCK = 4 << 20

#: The name of a group's marks.
MARKS = "marks"


def copy_store(
    source: str | os.PathLike[str], target: str | os.PathLike[str], *, overwrite: bool = False
) -> str:
    """Copy a scene store, with its marks, unless it is there already; check every byte of it.

    ``client.run(bfrt.copy_store, source, target)`` copies it to the disk of each worker. Workers
    of one machine wait for the one that copies. A store is opened by the same path everywhere: the
    client copies it too, and opens the copy.

    Parameters
    ----------
    source : path-like
        The store.
    target : path-like
        Its copy.
    overwrite : bool
        Whether it may replace another store; nothing else is ever replaced.

    Returns
    -------
    str
        The copy's absolute path.

    Raises
    ------
    StoreError
        If the source is no store, or its contents or the copy's differ from what was written.
    SettingError
        If the target cannot be a store, or is another one.
    DiskFullError, StreamError, ResourceError
        If the system refuses; nothing is left behind.
    """
    store = open_store(source)
    path = check_new_store(target)
    with in_memory(f"{path}: copying a store"), _alone(path.parent):
        there = header_at(path) if is_folder(path) else b""
        if there and there != store.folder.header and not overwrite:
            raise SettingError(
                f"{path}: found another store, expected {store.path}, or nothing: overwrite=True "
                "replaces it"
            )
        if not _is_whole(path, store):
            folder = AtomicFolder(path, durable=True)
            try:
                folder.create()
                _copy(store, folder.aside)
                _verify(open_store(folder.aside))
                folder.sync()
                folder.take_name()
            except BaseException:
                folder.abandon()
                raise
    return os.fspath(path)


def _is_whole(path: Path, store: Store) -> bool:
    """Tell whether a path has the same store already, whole; what is damaged is copied again."""
    if not is_there(path):
        return False
    with suppress(BfrtError):
        found = open_store(path)
        if found.folder.header == store.folder.header:
            _verify(found)
            return True
    return False


def _verify(store: Store) -> None:
    store.verify()
    for group in store.groups:
        verify_marks(store, group)


def _copy(store: Store, folder: Path) -> None:
    """Copy the files of a store into a folder."""
    marks = [store.path / str(group.number) / MARKS for group in store.groups]
    listed = [store.path / HEADER, store.path / MADE, *(path for path, _ in store.files())]
    for path in [*listed, *filter(is_file, marks)]:
        copy = folder / path.relative_to(store.path)
        with calling(copy, "creating"):
            copy.parent.mkdir(parents=True, exist_ok=True)
        _copy_file(store, path, copy)


def _copy_file(store: Store, path: Path, copy: Path) -> None:
    with calling(path, "opening"):
        source = FileIO(path, "rb", opener=store.folder.opener)
    try:
        with calling(copy, "creating"):
            made = copy.open("wb", buffering=0)
        with closing(made, copy):
            done = 0
            while block := _block(source, path, done):
                put(made, block, copy)
                done += len(block)
    finally:
        give_up(source)
    sync_file(copy)


def _block(source: FileIO, path: Path, offset: int) -> bytes:
    with calling(path, "reading", offset):
        return source.read(BLOCK)


@contextmanager
def _alone(folder: Path) -> Iterator[None]:
    """Let one process at a time do what is in a block with a folder, which is made."""
    with calling(folder, "creating"):
        folder.mkdir(parents=True, exist_ok=True)
        descriptor = os.open(folder, os.O_RDONLY | os.O_DIRECTORY | os.O_CLOEXEC)
    try:
        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX)
        except OSError as error:
            if error.errno not in LOCKLESS:
                with calling(folder, "locking"):
                    raise
        yield
    finally:
        give_up(descriptor)
