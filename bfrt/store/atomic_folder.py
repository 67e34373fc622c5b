"""A folder that exists whole under its name, or not at all.

It is written aside, under a temporary name beside its own, made durable and renamed. A folder that
has the name already steps aside first, and goes when the new one is in its place.
"""

from __future__ import annotations

import logging
import os
import secrets
from pathlib import Path

from bfrt.paths import mode_at, without_links
from bfrt.refusals import calling, refused
from bfrt.streams.atomic_write import sync_folder
from bfrt.streams.removal import remove_folder

log = logging.getLogger(__name__)


class AtomicFolder:
    """Makes a folder, or replaces one.

    Parameters
    ----------
    path : Path
        Its name. A link is followed: its target is replaced, not the link.
    durable : bool
        Whether it outlives a loss of power once it has its name.

    Attributes
    ----------
    target : Path
        The name without links.
    aside : Path
        Where it is written to.
    """

    def __init__(self, path: Path, durable: bool) -> None:
        self.path = path
        self.durable = durable
        self.target = without_links(path)
        # 40 characters are at most 160 bytes, which leaves the name below every system's 255.
        name = f".{self.target.name[:40]}.{secrets.token_hex(8)}.part"
        self.aside = self.target.with_name(name)

    def create(self) -> None:
        """Create it aside, with the folders above it."""
        with calling(self.aside, "creating"):
            self.aside.mkdir(parents=True)

    def sync(self) -> None:
        """Make the entries of all its folders durable, where that is wanted."""
        for folder, _, _ in os.walk(self.aside) if self.durable else ():
            sync_folder(Path(folder))

    def take_name(self) -> None:
        """Take the name from what has it; nothing has changed where that fails."""
        old = self.aside.with_suffix(".old")
        replaces = mode_at(self.target) != 0
        try:
            if replaces:
                self.target.rename(old)
            self.aside.rename(self.target)
            if self.durable:
                sync_folder(self.target.parent)
        except BaseException as error:
            self._step_back(old, replaces)
            if isinstance(error, OSError):
                raise refused(self.path, 0, error, "renaming to it") from error
            raise
        if replaces and (refusal := remove_folder(old)) is not None:
            log.warning("%s: what was replaced could not be removed: %s", old, refusal)

    def _step_back(self, old: Path, replaces: bool) -> None:
        """Undo the renames that were done."""
        renamed = not self.aside.exists() and self.target.exists()
        if renamed and old.exists() == replaces:
            self.target.rename(self.aside)
        if replaces and not self.target.exists():
            old.rename(self.target)

    def abandon(self) -> None:
        """Remove what was written aside."""
        remove_folder(self.aside)
