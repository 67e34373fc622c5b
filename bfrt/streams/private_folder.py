"""Folders of the user's own, for files whose names others can foretell."""

from __future__ import annotations

import contextlib
import os
import stat
from pathlib import Path

from bfrt.errors import SettingError
from bfrt.refusals import refused
from bfrt.streams.ownership import FOLDER, look_at

#: Permissions that let others change what is in a folder, or in a file.
OTHERS = stat.S_IWGRP | stat.S_IWOTH


def user() -> int:
    """Return the number of the user that this process acts for; 0 where the system has none."""
    return os.geteuid() if hasattr(os, "geteuid") else 0


def cache_folder() -> Path:
    """Return the user's folder for what bfrt can make again, which need not be there.

    Raises
    ------
    SettingError
        If the user has no home, and ``XDG_CACHE_HOME`` names no folder.
    """
    named = Path(os.environ.get("XDG_CACHE_HOME", ""))
    if named.is_absolute():
        return named / "bfrt"
    try:
        return Path.home() / ".cache" / "bfrt"
    except RuntimeError:
        raise SettingError(
            "marks: found no home of the user for them, expected one, or XDG_CACHE_HOME, or scratch"
        ) from None


def make_private(folder: Path) -> None:
    """Make a folder that only the user can write to, or see that one is there.

    Raises
    ------
    SettingError
        If what is there is a link, another user's, or one that others may write to.
    StreamError
        As the system refuses.
    """
    try:
        folder.parent.mkdir(parents=True, exist_ok=True)
        folder.mkdir(0o700, exist_ok=True)
    except FileExistsError:  # no folder: found below
        pass
    except OSError as error:
        raise refused(folder, 0, error, "creating") from error
    if not is_private(folder, FOLDER):
        raise SettingError(
            f"{folder}: found something else than a folder that is ours and that only we may write "
            "to, expected it for marks: name another place by scratch or XDG_CACHE_HOME"
        )


def is_private(path: Path, kind: str) -> bool:
    """Tell whether a file or folder is no link, is ours, and only we may write to it."""
    try:
        descriptor = look_at(path, kind)
    except OSError:
        return False
    try:
        found = os.fstat(descriptor)
    except OSError:
        return False
    finally:
        with contextlib.suppress(OSError):
            os.close(descriptor)
    sort = stat.S_ISDIR if kind == FOLDER else stat.S_ISREG
    owned = found.st_uid == user() and not found.st_mode & OTHERS
    return sort(found.st_mode) and (owned or os.name == "nt")
