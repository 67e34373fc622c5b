"""The files of an answer: all of them are in their folder, or none is.

::

    a folder of nothing else     made aside, and renamed as one; an answer that is there goes
    one that has other things    files take their names one after the other; where that fails
                                 what was there before comes back
"""

from __future__ import annotations

import os
from collections.abc import Collection, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from bfrt.paths import is_folder, is_there, names_in, without_links
from bfrt.refusals import calling
from bfrt.store.atomic_folder import AtomicFolder
from bfrt.streams.atomic_write import atomic_paths, sync_file


@contextmanager
def answer_paths(folder: Path, names: Collection[str]) -> Iterator[list[Path]]:
    """Give paths to write to, of files that are all in a folder when the block has ended, or none.

    Parameters
    ----------
    folder : Path
        The folder, which is made, with those above it; a link is followed.
    names : collection of str
        Names of the files.

    Yields
    ------
    list of Path
        A path for each name. The block makes the files, and has closed them when it ends.

    Raises
    ------
    StreamError
        If the system refuses; `DiskFullError` where it has no room.
    """
    target = without_links(folder)
    if is_shared(target, names):
        with atomic_paths([target / name for name in names]) as paths:
            yield paths
        return
    with made_folder(target.parent):
        made = AtomicFolder(target, durable=True)
        try:
            made.create()
            paths = [made.aside / name for name in names]
            yield paths
            for path in paths:
                sync_file(path)
            made.sync()
            made.take_name()
        except BaseException:
            made.abandon()
            raise


def is_shared(folder: Path, names: Collection[str]) -> bool:
    """Tell whether a folder cannot be replaced as one: others' files are in it, or it is fixed."""
    if not is_folder(folder):
        return False
    with calling(folder, "listing"):
        there = set(names_in(folder))
    fixed = os.path.ismount(folder) or not os.access(folder.parent, os.W_OK | os.X_OK)
    return fixed or not there <= set(names)


@contextmanager
def made_folder(folder: Path) -> Iterator[None]:
    """Make a folder, with those above it; if what is done in it fails, remove those made."""
    missing = [each for each in (folder, *folder.parents) if not is_there(each)]
    try:
        with calling(folder, "creating"):
            folder.mkdir(parents=True, exist_ok=True)
        yield
    except BaseException:
        for each in missing:
            with suppress(OSError):  # not there, or others put something in
                each.rmdir()
        raise
