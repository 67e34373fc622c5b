"""What can go wrong, each with its own exception.

Every message is one sentence that says where, what was found, and what was expected.
"""

from __future__ import annotations

import os
from typing import Any


class BfrtError(Exception):
    """Base of every exception that bfrt raises on purpose."""


class SceneError(BfrtError, ValueError):
    """Input data that is not a scene: a bad file, a NaN, a count that lies."""


class StoreError(BfrtError, ValueError):
    """A scene store that is truncated, damaged, of another version, or no store at all."""


class BudgetError(BfrtError, MemoryError):
    """The memory budget is below what the work needs; the message names the least that works."""


class SettingError(BfrtError, ValueError):
    """A setting that cannot be honoured."""


class Cancelled(BfrtError):
    """A progress callback returned False."""


class StreamError(BfrtError, OSError):
    """A read or write that the system refused, with the file and the offset."""

    def __init__(self, path: str | os.PathLike[str], offset: int, errno: int, doing: str) -> None:
        self.path = os.fspath(path)
        self.offset = offset
        self._doing = doing
        super().__init__(errno, f"{self.path}: {doing} at byte {offset}: {os.strerror(errno)}")

    def __str__(self) -> str:
        return str(self.args[1])

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickle by the arguments: a pool of processes hands its errors over so."""
        return type(self), (self.path, self.offset, self.errno, self._doing)


class DiskFullError(StreamError):
    """No space is left for a write (ENOSPC, or a quota)."""


class ShortReadError(BfrtError, EOFError):
    """A file ended before a record that its header promised."""

    def __init__(self, path: str | os.PathLike[str], offset: int, asked: int, left: int) -> None:
        self.path = os.fspath(path)
        self.offset = offset
        self._sizes = asked, left
        super().__init__(
            f"{self.path}: asked for {asked} bytes at byte {offset}, found {left}: "
            "the file is truncated"
        )

    def __reduce__(self) -> tuple[Any, ...]:
        return type(self), (self.path, self.offset, *self._sizes)
