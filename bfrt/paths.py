"""Paths that a caller gives: what is one, and what can be written to, before the work for it."""

from __future__ import annotations

import errno
import os
import stat
from collections.abc import Iterable, Iterator
from pathlib import Path

from bfrt.errors import SettingError
from bfrt.refusals import calling, refused

#: The file that makes a folder a scene store, and what is in it.
HEADER = "scene.json"
MAGIC = "bfrt scene store"

#: What the system says of a path to something that is not there.
ABSENT = (errno.ENOENT, errno.ENOTDIR)

#: What it says, too, of one that we may not know, or that it does not take for a name.
UNKNOWN = (*ABSENT, errno.EACCES, errno.EPERM, errno.EISDIR, errno.ENAMETOOLONG, errno.ELOOP)


def path_of(name: str, value: object) -> Path:
    """Return what a caller gives as a path.

    Raises
    ------
    SettingError
        If it is none, or has a NUL or half a letter, which no system takes; or is empty, which
        pathlib takes for the working folder, and no system for anything.
    """
    if not isinstance(value, (str, os.PathLike)):
        raise SettingError(f"{name}: found {type(value).__name__}, expected a path")
    path = os.fsdecode(value)
    if not path:
        raise SettingError(f"{name}: found an empty path, expected one with a name")
    if "\0" in path:
        raise SettingError(f"{name}: found {path!r:.80}, expected a path without NUL")
    try:
        os.fsencode(path)
    except UnicodeEncodeError:
        raise SettingError(
            f"{name}: found {path!r:.80}, expected a path that can be encoded"
        ) from None
    return Path(path)


def without_links(path: str | os.PathLike[str]) -> Path:
    """Return the path that a path stands for, absolute; parts that are not there have no links.

    Raises
    ------
    StreamError
        If the system refuses to say it.
    """
    try:
        return Path(os.path.realpath(path, strict=True))
    except OSError as error:
        if error.errno not in UNKNOWN:
            raise refused(path, 0, error, "examining") from error
        return Path(os.path.realpath(path))


def facts_at(path: Path) -> os.stat_result | None:
    """Return what the system says of a path, links followed; None if there is nothing.

    Raises
    ------
    StreamError
        If it refuses to say it.
    """
    with calling(path, "examining"):
        try:
            return path.stat()
        except OSError as error:
            if error.errno in ABSENT:
                return None
            raise


def mode_at(path: Path) -> int:
    """Return what is at a path (``st_mode``), 0 for nothing; `StreamError` as `facts_at`."""
    found = facts_at(path)
    return 0 if found is None else found.st_mode


def is_there(path: Path) -> bool:
    """Tell whether a path has a name, of whatever it is, a link that leads nowhere too.

    Raises
    ------
    StreamError
        If the system refuses to say it.
    """
    with calling(path, "examining"):
        try:
            path.lstat()
        except OSError as error:
            if error.errno in (*ABSENT, errno.ENAMETOOLONG):
                return False
            raise
    return True


def is_folder(path: Path) -> bool:
    """Tell whether a path is a folder; `StreamError` where the system refuses to say it."""
    return stat.S_ISDIR(mode_at(path))


def is_file(path: Path) -> bool:
    """Tell whether a path is a file; `StreamError` where the system refuses to say it."""
    return stat.S_ISREG(mode_at(path))


def check_apart(*paths: str | os.PathLike[str]) -> None:
    """Refuse paths of which two are one: what is written last would replace the other.

    Raises
    ------
    SettingError
        If two are.
    """
    seen: set[str] = set()
    for path in paths:
        target = str(without_links(path_of("output", path)))
        if target in seen:
            raise SettingError(f"{path}: found it twice, expected a path of its own for each file")
        seen.add(target)


def check_file(path: str | os.PathLike[str]) -> None:
    """Refuse a file that could not be written.

    Raises
    ------
    SettingError
        If it is something else than a file, its folder is not there or not ours to write to, its
        name is too long, or it is in a scene store.
    """
    given = path_of("output", path)
    target = without_links(given)
    mode = _mode(str(given), target)
    if mode is not None and not stat.S_ISREG(mode):
        raise SettingError(f"{given}: found something else than a file, expected a file or nothing")
    check_outside(str(given), target)
    if not is_folder(target.parent):
        raise SettingError(f"{given}: found no folder {target.parent}, expected one that is there")
    _check_ours(str(given), target.parent)


def check_folder(name: str, path: str | os.PathLike[str], files: Iterable[str]) -> Path:
    """Return a folder that files can be written to; it need not be there.

    Raises
    ------
    SettingError
        If it is or is under a file, is not ours to write to, has too long a name, or is in a scene
        store; or if one of the files is there and is no file.
    """
    given = path_of(name, path)
    place = f"{name}: {given}"
    folder = without_links(given)
    each = check_names(place, folder)
    if not is_folder(each):
        raise SettingError(f"{name}: found the file {each}, expected a folder {given}")
    _check_ours(place, each)
    check_outside(place, folder)
    for file in files:
        mode = _mode(place, folder / file)
        if mode is not None and not stat.S_ISREG(mode):
            raise SettingError(f"{place}: found {file} that is no file, expected a file or nothing")
    return given


def check_names(place: str, path: Path) -> Path:
    """Refuse names that are too long; return what there is of a path, its first folders or all.

    Parameters
    ----------
    place : str
        What the error begins with.
    path : Path
        One without links.

    Raises
    ------
    SettingError
        If one is.
    """
    there = next(each for each in (path, *path.parents) if _mode(place, each) is not None)
    longest = os.pathconf(there, "PC_NAME_MAX") if hasattr(os, "pathconf") else 255
    if any(len(os.fsencode(part)) > longest for part in path.relative_to(there).parts):
        raise _too_long(place)
    return there


def check_outside(place: str, path: Path) -> None:
    """Refuse a path to write to that is in a scene store, whose files are its own.

    Parameters
    ----------
    place : str
        What the error begins with.

    Raises
    ------
    SettingError
        If it is.
    """
    for each in (path, *path.parents):
        if is_marked(each):
            raise SettingError(
                f"{place}: found it to be in the store {each}, expected another folder"
            )


def names_in(folder: Path) -> list[str]:
    """Return the names in a folder, sorted.

    Raises
    ------
    OSError
        If the system refuses to list it.
    """
    return [entry.name for entry in entries_in(folder)]


def entries_in(folder: Path) -> list[os.DirEntry[str]]:
    """Return what is in a folder, by name; where a signal interrupts the call it is made again.

    Raises
    ------
    OSError
        If the system refuses to list it.
    """
    while True:
        try:
            with os.scandir(folder) as entries:
                return sorted(entries, key=lambda entry: entry.name)
        except InterruptedError:  # which Python leaves to its callers here, and nowhere else
            continue


def walk(folder: Path) -> Iterator[tuple[Path, list[str], list[str]]]:
    """Yield a folder and all below, from above: each, its folders, and what else is there.

    Names that are taken out of the folders are not gone into. A link is no folder.

    Raises
    ------
    OSError
        If the system refuses to list one; `os.walk` passes over it without a word.
    """
    entries = entries_in(folder)
    below = [entry.name for entry in entries if entry.is_dir(follow_symlinks=False)]
    folders = set(below)
    yield folder, below, [entry.name for entry in entries if entry.name not in folders]
    for name in below:
        yield from walk(folder / name)


def is_marked(folder: Path) -> bool:
    """Tell whether a folder has a store's header, of any version, whole or damaged."""
    return MAGIC.encode() in header_at(folder)


def header_at(folder: Path) -> bytes:
    """Read what a folder has for a store's header, of any version; nothing where it has none.

    Raises
    ------
    StreamError
        If the system refuses to read it.
    """
    with calling(folder / HEADER, "reading"):
        try:
            return (folder / HEADER).read_bytes()
        except OSError as error:
            if error.errno in UNKNOWN:
                return b""
            raise


def _mode(place: str, path: Path) -> int | None:
    """Return what is at a path, as the system says it; None if there is nothing."""
    try:
        return path.stat().st_mode
    except OSError as error:
        if error.errno in ABSENT:
            return None
        if error.errno == errno.ENAMETOOLONG:
            raise _too_long(place) from None
        said = os.strerror(error.errno or errno.EIO)
        raise SettingError(f"{place}: expected a path to write to: {said}") from None


def _too_long(place: str) -> SettingError:
    # A name of a few hundred letters does not make the sentence clearer.
    return SettingError(f"{place:.200}: found too long a name, expected one that the system takes")


def _check_ours(place: str, folder: Path) -> None:
    if not os.access(folder, os.W_OK | os.X_OK):
        raise SettingError(f"{place}: found the folder {folder}, expected one that we may write to")
