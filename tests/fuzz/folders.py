"""Where inputs are tried."""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

#: In memory, if the system has such a folder.
MEMORY_FOLDER = Path("/dev/shm")


@contextmanager
def in_memory(name: str) -> Iterator[Path]:
    """Make a folder, in memory if the system has such, and remove it at the end.

    It stays where the process dies.
    """
    there = MEMORY_FOLDER if MEMORY_FOLDER.is_dir() else None
    with tempfile.TemporaryDirectory(prefix=f"fuzz-{name}-", dir=there) as folder:
        yield Path(folder)
