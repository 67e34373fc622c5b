"""Temporary things with names: each is locked by its owner for as long as that lives.

A temporary file or folder stands beside what it will become::

    .NAME.bfrt-HEX.tmp     a file that is written
    .NAME.bfrt-HEX.part    a folder that is written
    .NAME.bfrt-HEX.old     a folder that is replaced by the .part of the same number

Its lock is the system's (``flock``) on the thing itself, which ends with the process, however that
ends: what has such a name and can be locked is litter (`bfrt.streams.litter`). Who creates one
locks it after it is there, so that a cleaner may come between the two: the creator then sees that
the name is gone, or is another's, and tries again.
"""

from __future__ import annotations

import contextlib
import errno
import os
import re
import secrets
import zlib
from pathlib import Path
from typing import NamedTuple

from bfrt.refusals import give_up
from bfrt.streams.removal import remove_file, remove_folder

try:
    import fcntl
except ImportError:  # a system that has no such locks
    fcntl = None  # type: ignore[assignment]

FILE, FOLDER, REPLACED = "tmp", "part", "old"

NAME = re.compile(
    r"\.(?P<stem>.+)\.bfrt-(?P<number>[0-9a-f]{16})\.(?P<kind>tmp|part|old)", re.DOTALL
)

#: Bytes of a name that is kept whole; with the rest it stays below every system's 255.
WHOLE_BYTES = 200

#: Characters that are kept of a longer one, which are at most 160 bytes.
KEPT = 40

#: What the stem of a longer one is.
CUT = re.compile(rf".{{{KEPT}}}~[0-9a-f]{{8}}", re.DOTALL)

#: Creations that cleaners may spoil before it is an error.
TRIES = 100

#: What the system says where it has no locks of this sort, for this thing or at all.
LOCKLESS = tuple(
    getattr(errno, name)
    for name in ("ENOLCK", "EOPNOTSUPP", "ENOTSUP", "ENOSYS", "EINVAL", "EBADF")
    if hasattr(errno, name)
)

#: How a thing is opened to lock it: it is not followed where it is a link, nor waited for.
LOOK = os.O_RDONLY | sum(
    getattr(os, name, 0) for name in ("O_CLOEXEC", "O_NOFOLLOW", "O_NONBLOCK", "O_BINARY")
)
CREATE = (os.O_RDWR | os.O_CREAT | os.O_EXCL) | (LOOK & ~getattr(os, "O_NONBLOCK", 0))


class TemporaryName(NamedTuple):
    """Holds the parts of a temporary thing's name.

    Attributes
    ----------
    stem : str
        The name of what it will become, as `stem_of` keeps it.
    number : str
        Sixteen hexadecimal digits, by chance.
    kind : str
        `FILE`, `FOLDER` or `REPLACED`.
    """

    stem: str
    number: str
    kind: str

    def __str__(self) -> str:
        return f".{self.stem}.bfrt-{self.number}.{self.kind}"


def stem_of(name: str) -> str:
    """Return what a temporary name has of a name: all, or a long one's begin and its CRC."""
    data = os.fsencode(name)
    return name if len(data) <= WHOLE_BYTES else f"{name[:KEPT]}~{zlib.crc32(data):08x}"


def parsed(name: str) -> TemporaryName | None:
    """Return the parts of a temporary thing's name; None of any other name."""
    found = NAME.fullmatch(name)
    return None if found is None else TemporaryName(*found.groups())


#: What this process has created and not yet released, by process: a fork has no part in it.
_MADE: dict[Path, int] = {}


class Owned:
    """Holds a temporary file or folder, with its lock.

    Attributes
    ----------
    path : Path
        Its name.
    descriptor : int
        The thing itself, locked; of a file it can be written to.
    """

    def __init__(self, path: Path, descriptor: int) -> None:
        self.path = path
        self.descriptor = descriptor

    def is_at(self, path: Path) -> bool:
        """Tell whether a name is this thing's."""
        return self.descriptor >= 0 and is_named(self.descriptor, path)

    def remove(self) -> None:
        """Remove what has the temporary name, as far as the system lets us, and release it."""
        remove(self.path)
        self.release()

    def release(self) -> None:
        """Give the lock back: the thing has got its name, or is gone."""
        if not os.path.lexists(self.path):  # else it is for `made_here`, or the next run
            _MADE.pop(self.path, None)
        descriptor, self.descriptor = self.descriptor, -1
        if descriptor >= 0:
            with contextlib.suppress(OSError):  # nothing was written by it that is not synced
                os.close(descriptor)

    def __del__(self) -> None:
        self.release()


def create_file(target: Path, mode: int = 0o666) -> Owned:
    """Create an empty file beside what it will become, and lock it.

    Raises
    ------
    OSError
        As the system refuses.
    """
    return _created(target, FILE, mode)


def create_folder(target: Path, mode: int = 0o777) -> Owned:
    """Create a folder beside what it will become, and lock it; `OSError` as the system refuses."""
    return _created(target, FOLDER, mode)


def _created(target: Path, kind: str, mode: int) -> Owned:
    for _ in range(TRIES):
        name = TemporaryName(stem_of(target.name), secrets.token_hex(8), kind)
        path = target.with_name(str(name))
        _MADE[path] = os.getpid()  # before it is there: an interrupt may come at any time
        try:
            owned = _create(path, kind, mode)
        except FileExistsError:  # another's, by a chance of 2^-64
            _MADE.pop(path, None)
        except FileNotFoundError:
            _MADE.pop(path, None)
            if not target.parent.is_dir():
                raise
        except BaseException:
            remove(path)
            _MADE.pop(path, None)
            raise
        else:
            if owned is not None:
                return owned
    raise OSError(errno.EEXIST, os.strerror(errno.EEXIST), str(target))


def _create(path: Path, kind: str, mode: int) -> Owned | None:
    """Create a thing and lock it; None where a cleaner took it for litter meanwhile."""
    if kind == FILE:
        descriptor = os.open(path, CREATE, mode)
    else:
        path.mkdir(mode)
        descriptor = look_at(path, kind)
    owned = Owned(path, descriptor)
    try:
        if lock(descriptor) is not False and is_named(descriptor, path):
            return owned
        owned.remove()
        return None
    except BaseException:
        owned.remove()
        raise


def look_at(path: Path, kind: str) -> int:
    """Return a descriptor of a thing, by which it can be locked; `OSError` if it is a link."""
    return os.open(path, LOOK | (0 if kind == FILE else getattr(os, "O_DIRECTORY", 0)))


def lock(descriptor: int) -> bool | None:
    """Lock a thing, without waiting.

    Returns
    -------
    bool or None
        Whether it is locked now, for the descriptor's life; None where the system cannot.

    Raises
    ------
    OSError
        For other refusals.
    """
    if fcntl is None:
        return None
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    except OSError as error:
        if error.errno in LOCKLESS:
            return None
        raise
    return True


def own_folder(path: Path) -> int | None:
    """Lock a folder by its name, links followed; create it and those above, unless it is there.

    One that its owner removes meanwhile is created again.

    Returns
    -------
    int or None
        A descriptor, which has the lock for its life where the system has such locks; None where
        another has it.

    Raises
    ------
    OSError
        As the system refuses.
    """
    for _ in range(TRIES):
        place = Path(os.path.realpath(path))
        place.mkdir(parents=True, exist_ok=True)
        descriptor = look_at(place, FOLDER)
        try:
            ours = lock(descriptor) is not False
            if ours and is_named(descriptor, place):
                return descriptor
        except BaseException:
            give_up(descriptor)
            raise
        give_up(descriptor)
        if not ours:
            return None
    raise OSError(errno.EEXIST, os.strerror(errno.EEXIST), str(path))


def is_named(descriptor: int, path: Path) -> bool:
    """Tell whether a name, not followed, is still that of an open thing."""
    try:
        return os.path.samestat(os.fstat(descriptor), path.lstat())
    except OSError:
        return False


def remove(path: Path) -> None:
    """Remove a file, or a folder with all that is in it, as far as the system lets us."""
    name = parsed(path.name)
    if name is not None and name.kind == FILE:
        remove_file(path)
    else:
        remove_folder(path)


def made_here() -> list[Path]:
    """Return what this process has created and neither renamed nor removed."""
    return [path for path, process in list(_MADE.items()) if process == os.getpid()]


def forget(path: Path) -> None:
    """Have a thing no longer count as created here and left."""
    _MADE.pop(path, None)
