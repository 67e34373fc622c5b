"""What ended processes left: found by its name, told from what is in use by its lock, removed.

The next run that writes into a folder removes the litter there first (`sweep`), and ``bfrt clean``
does it by hand (`clear`). Whoever removes a thing holds its lock meanwhile, so that a thing that
is just created is never taken from its creator unseen.

A folder that is replaced where the system cannot exchange two names is away for a moment: it
steps aside as ``.old``, and the new one, ``.part`` of the same number, is whole by then. A process
that ends in between leaves both, and none under the name: `restore` gives it to the new one.
"""

from __future__ import annotations

import atexit
import contextlib
import logging
import os
import re
import stat
import time
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

from bfrt.paths import is_marked, names_in
from bfrt.streams.ownership import (
    CUT,
    FILE,
    FOLDER,
    REPLACED,
    TemporaryName,
    forget,
    lock,
    look_at,
    made_here,
    parsed,
    remove,
    stem_of,
)
from bfrt.streams.ownership import is_named as still_named

log = logging.getLogger(__name__)

#: Seconds for which a folder that was swept is not looked at again.
SWEPT_FOR = 60.0

#: Seconds that a folder which is being replaced is waited for, and between two looks.
REPLACING, LOOKS = 1.0, 0.01

#: File systems whose locks other machines may not see, and the table that names them on Linux.
SHARED = {
    "9p", "afs", "beegfs", "ceph", "cifs", "coda", "gfs2", "gpfs", "lustre", "ncpfs", "nfs", "nfs4",
    "ocfs2", "orangefs", "smb3", "smbfs", "virtiofs",
}  # fmt: skip
MOUNTS = Path("/proc/self/mountinfo")

#: Blanks and the like in that table.
ESCAPED = re.compile(r"\\([0-7]{3})")

_swept: dict[Path, float] = {}


class Litter(NamedTuple):
    """Describes a thing that an ended process left.

    Attributes
    ----------
    path : Path
        The file or folder.
    bytes : int
        What it takes: the sizes of its files.
    """

    path: Path
    bytes: int


def sweep(folder: Path) -> None:
    """Remove the litter of a folder before something is created there; never fail.

    A folder that was swept a moment ago is passed over, so that a thousand files cost no thousand
    looks at it.
    """
    now = time.monotonic()
    if now - _swept.get(folder, -SWEPT_FOR) < SWEPT_FOR:
        return
    _swept[folder] = now
    try:
        for left in clear(folder):
            log.info("%s: removed, %d bytes that an ended process left", left.path, left.bytes)
    except OSError as error:
        log.info("%s: litter could not be removed: %s", folder, error)


def clear(folder: Path, *, dry: bool = False) -> list[Litter]:
    """Remove the litter of a folder, not of those in it; return what it was.

    Parameters
    ----------
    folder : Path
        One that is not there, or is not ours to read, has no litter.
    dry : bool
        Whether it is only looked for.
    """
    try:
        names = names_in(folder)
    except OSError:
        return []
    found: list[Litter] = []
    temporary = [name for name in map(parsed, names) if name is not None]
    if not temporary or is_shared(folder):
        return found
    for name in temporary:
        if name.kind == REPLACED and not dry:
            restore_from(folder, name)
        left = _cleared(folder, name, dry)
        if left is not None:
            found.append(left)
    return found


def _cleared(folder: Path, name: TemporaryName, dry: bool) -> Litter | None:
    """Remove one thing, if it is litter and goes; return it then."""
    path = folder / str(name)
    with claimed(path) as ours:
        if not ours or _waits(folder, name):
            return None
        left = Litter(path, bytes_of(path))
        if not dry:
            remove(path)
            if os.path.lexists(path):
                log.info("%s: could not be removed", path)
                return None
        return left


@contextlib.contextmanager
def claimed(path: Path) -> Iterator[bool]:
    """Hold the lock of a temporary thing in a block; tell whether nobody else has it.

    A thing that cannot be locked, that another user owns, or that is not of its name's sort is
    somebody else's.
    """
    name = parsed(path.name)
    try:
        descriptor = look_at(path, FILE if name is None else name.kind)
    except OSError:
        yield False
        return
    try:
        ours = False
        with contextlib.suppress(OSError):
            ours = _is_ours(descriptor, name) and lock(descriptor) is True
        yield ours and still_named(descriptor, path)
    finally:
        with contextlib.suppress(OSError):
            os.close(descriptor)


def _is_ours(descriptor: int, name: TemporaryName | None) -> bool:
    found = os.fstat(descriptor)
    sort = stat.S_ISREG if name is None or name.kind == FILE else stat.S_ISDIR
    return sort(found.st_mode) and (not hasattr(os, "geteuid") or found.st_uid == os.geteuid())


def _waits(folder: Path, name: TemporaryName) -> bool:
    """Tell whether a thing is half of a replacement that has not ended: none has the name."""
    other = {FOLDER: REPLACED, REPLACED: FOLDER}.get(name.kind)
    if other is None or not (folder / str(name._replace(kind=other))).is_dir():
        return False
    target = target_of(folder, name)
    return target is None or not os.path.lexists(target)


def target_of(folder: Path, name: TemporaryName) -> Path | None:
    """Return what a temporary thing would have become; None where its name is a part of that."""
    return None if CUT.fullmatch(name.stem) else folder / name.stem


def restore(target: Path) -> bool:
    """End the replacement of a folder that another process began, where none has the name.

    One that is under way is waited for.

    Parameters
    ----------
    target : Path
        The name, without links.

    Returns
    -------
    bool
        Whether a folder has it now.
    """
    end = time.monotonic() + REPLACING
    while not os.path.lexists(target):
        stem = stem_of(target.name)
        try:
            names = [parsed(name) for name in names_in(target.parent)]
        except OSError:
            return False
        pairs = [name for name in names if name and (name.stem, name.kind) == (stem, REPLACED)]
        for name in pairs:
            restore_from(target.parent, name, target)
        if not pairs or time.monotonic() > end:
            break
        time.sleep(LOOKS)
    return os.path.lexists(target)


def restore_from(folder: Path, name: TemporaryName, target: Path | None = None) -> None:
    """End the replacement that a ``.old`` is of, if it is half done and nobody is at it.

    Where there are no locks it is done too: what is renamed is whole, and a process that is at it
    finds its own folder in place (`bfrt.store.atomic_folder`).
    """
    target = target or target_of(folder, name)
    old = folder / str(name)
    new = folder / str(name._replace(kind=FOLDER))
    if target is None or os.path.lexists(target) or not new.is_dir():
        return
    with contextlib.suppress(OSError), _free(old) as nobody:
        if nobody and not os.path.lexists(target):
            _end(old, new, target)


def _end(old: Path, new: Path, target: Path) -> None:
    """Give a name that none has to the new folder, or back to the old one."""
    whole = is_marked(new)
    (new if whole else old).rename(target)
    log.info("%s: its replacement is %s", target, "finished" if whole else "undone")


@contextlib.contextmanager
def _free(old: Path) -> Iterator[bool]:
    """Tell whether nobody is known to be at a folder, whose lock is held in the block."""
    descriptor = look_at(old, REPLACED)
    try:
        yield _is_ours(descriptor, parsed(old.name)) and lock(descriptor) is not False
    finally:
        os.close(descriptor)


def bytes_of(path: Path) -> int:
    """Return the sizes of a file, or of a folder's files."""
    total = 0
    for place, _, names in os.walk(path):
        for name in names:
            with contextlib.suppress(OSError):
                total += (Path(place) / name).lstat().st_size
    if not total:
        with contextlib.suppress(OSError):
            found = path.lstat()
            total = found.st_size if stat.S_ISREG(found.st_mode) else 0
    return total


def is_shared(folder: Path) -> bool:
    """Tell whether a folder's file system is one whose locks other machines may not see."""
    kind = file_system_of(folder)
    return kind in SHARED or (kind.startswith("fuse.") and kind != "fuse.fuse-overlayfs")


def file_system_of(folder: Path) -> str:
    """Return the kind of file system that a folder is in, as Linux calls it; "" if unknown."""
    try:
        lines = MOUNTS.read_text(errors="surrogateescape").splitlines()
    except OSError:
        return ""
    place = Path(os.path.realpath(folder))
    best, kind = -1, ""
    for line in lines:
        fields, _, rest = line.partition(" - ")
        point = Path(ESCAPED.sub(lambda found: chr(int(found[1], 8)), fields.split()[4]))
        if len(point.parts) >= best and place.is_relative_to(point):  # of two, the later is on top
            best, kind = len(point.parts), rest.split()[0]
    return kind


def remove_own() -> None:
    """Remove what this process has created and not given a name, when it ends.

    Mostly there is nothing: who creates a thing removes it. An interrupt that comes between, or
    upon another, may have kept it from that.
    """
    for path in made_here():
        name = parsed(path.name)
        assert name is not None
        if name.kind == FOLDER and _is_kept(path, name):
            continue
        remove(path)
        forget(path)


def _is_kept(new: Path, name: TemporaryName) -> bool:
    """End the replacement by a folder of ours; tell whether both halves wait for the next run."""
    old = new.parent / str(name._replace(kind=REPLACED))
    if not old.is_dir():
        return False
    target = target_of(new.parent, name)
    if target is not None and not os.path.lexists(target):
        with contextlib.suppress(OSError):
            _end(old, new, target)
    if _waits(new.parent, name):
        return True
    remove(old)
    return False


atexit.register(remove_own)
