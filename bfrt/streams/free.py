"""Whether a disk has room for what will be written."""

from __future__ import annotations

import errno
import shutil
from pathlib import Path

from bfrt.errors import DiskFullError
from bfrt.refusals import refused


def check_free(folder: Path, needed: int, doing: str) -> None:
    """Refuse what the disk has no room for.

    Raises
    ------
    DiskFullError
        If fewer bytes are free.
    """
    try:
        free = shutil.disk_usage(folder).free
    except OSError as error:
        raise refused(folder, 0, error, "examining") from error
    if free < needed:
        message = f"{doing} {needed} bytes where {free} are free,"
        raise DiskFullError(folder, 0, errno.ENOSPC, message)
