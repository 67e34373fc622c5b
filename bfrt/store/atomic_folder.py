"""A folder that exists whole under its name, or not at all.

It is written aside, under a temporary name beside its own, made durable, and changes places in one
step with the folder that has the name, which goes then. Where the system has no such step that
folder steps aside first, by a rename of its own: a process that ends between the two leaves both,
and whoever looks for the name next gives it to the new one (`bfrt.streams.litter.restore`).
"""

from __future__ import annotations

import contextlib
import errno
import logging
import os
from collections.abc import Iterator
from pathlib import Path

from bfrt.errors import SettingError
from bfrt.paths import without_links
from bfrt.refusals import calling, refused
from bfrt.streams.atomic_write import sync_folder, sync_folders
from bfrt.streams.exchange import exchange
from bfrt.streams.litter import sweep
from bfrt.streams.ownership import FOLDER, Owned, create_folder, lock, look_at
from bfrt.streams.removal import remove_folder

log = logging.getLogger(__name__)

#: What the system says where another process has taken the name, or given it up, meanwhile.
MOVED = (errno.ENOENT, errno.ENOTEMPTY, errno.EEXIST)

#: Attempts to take a name that others take too.
TRIES = 10


class AtomicFolder:
    """Makes a folder, or replaces one.

    Parameters
    ----------
    path : Path
        Its name. A link is followed: its target is replaced, not the link.
    durable : bool
        Whether it outlives a loss of power once it has its name.
    kept : Path, optional
        Where it is written to, in place of a temporary name: a folder of the caller's, in the same
        file system, which may have a part of it already. It is left there where the work ends
        early.

    Attributes
    ----------
    target : Path
        The name without links.
    """

    def __init__(self, path: Path, durable: bool, kept: Path | None = None) -> None:
        self.path = path
        self.durable = durable
        self._kept = kept
        self.target = without_links(path)
        self._own: Owned | None = None

    @property
    def own(self) -> Owned:
        """Return the folder itself, once it is created."""
        assert self._own is not None
        return self._own

    @property
    def aside(self) -> Path:
        """Return where it is written to, once it is created."""
        return self.own.path

    @property
    def old(self) -> Path:
        """Return where what it replaces steps aside to, if they cannot change places."""
        return self.aside.with_suffix(".old")

    def create(self) -> None:
        """Create it aside, with the folders above it; litter there goes first."""
        with calling(self.target, "creating"):
            self.target.parent.mkdir(parents=True, exist_ok=True)
            sweep(self.target.parent)
            if self._kept is None:
                self._own = create_folder(self.target)
                return
            self._own = _taken(self._kept)
            place, found = self.target.parent, self._kept.stat().st_dev
            if found != place.stat().st_dev:
                raise SettingError(
                    f"{self._kept.parent}: found another file system than that of {place}, "
                    "expected the same: the store gets its name by a rename"
                )

    def sync(self) -> None:
        """Make the entries of all its folders durable, where that is wanted."""
        if self.durable:
            sync_folders(self.aside)

    def take_name(self) -> None:
        """Take the name from what has it; nothing has changed where that fails."""
        with self._replaced_held():
            try:
                self._put()
                if self.durable:
                    sync_folder(self.target.parent)
            except BaseException as error:
                self._step_back()
                if isinstance(error, OSError):
                    raise refused(self.path, 0, error, "renaming to it") from error
                raise
            for replaced in (self.aside, self.old):
                if (refusal := remove_folder(replaced)) is not None:
                    log.warning("%s: what was replaced could not be removed: %s", replaced, refusal)
        self.own.release()

    @contextlib.contextmanager
    def _replaced_held(self) -> Iterator[None]:
        """Hold the lock of what will be replaced: it is no litter until the new one is in place."""
        descriptor = -1
        try:
            try:
                descriptor = look_at(self.target, FOLDER)
                lock(descriptor)
            except FileNotFoundError:
                pass
            except OSError as error:
                raise refused(self.path, 0, error, "locking") from error
            yield
        finally:
            if descriptor >= 0:
                with contextlib.suppress(OSError):
                    os.close(descriptor)

    def _put(self) -> None:
        """Take the name, also where others do so at the same time: the last one has it."""
        for left in reversed(range(TRIES)):
            try:
                if not os.path.lexists(self.target):
                    self.aside.rename(self.target)
                elif not exchange(self.aside, self.target):
                    self.target.rename(self.old)
                    self.aside.rename(self.target)
                return
            except OSError as error:
                if self.own.is_at(self.target):  # who came by in between has finished it
                    return
                if error.errno not in MOVED or not left:
                    raise

    def _step_back(self) -> None:
        """Undo the renames that were done, as far as the system lets us."""
        with contextlib.suppress(OSError):
            if self.own.is_at(self.target):
                if os.path.lexists(self.aside):
                    exchange(self.aside, self.target)
                else:
                    self.target.rename(self.aside)
            if os.path.lexists(self.old) and not os.path.lexists(self.target):
                self.old.rename(self.target)

    def abandon(self) -> None:
        """Remove what was written aside; where none has the name, both halves are kept for it."""
        if self._own is None:
            return
        halves = os.path.lexists(self.old) and not os.path.lexists(self.target)
        if halves or self._kept is not None:
            self._own.release()
        else:
            remove_folder(self.old)
            self._own.remove()


def _taken(folder: Path) -> Owned:
    """Create a folder unless it is there, and lock it, whose name only its owner knows of."""
    folder.mkdir(exist_ok=True)
    owned = Owned(folder, look_at(folder, FOLDER))
    try:
        lock(owned.descriptor)
    except BaseException:
        owned.release()
        raise
    return owned
