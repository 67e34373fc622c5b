"""The exceptions that bfrt raises, one for each kind of fault.

Every message is one sentence that says where, what was found, and what was expected. It is shown on
one line, whatever is in the names of files.
"""

from __future__ import annotations

import os
from typing import Any


def escaped(text: str) -> str:
    """Return a text for a terminal: line feeds, controls and what is no text in a name escaped."""
    if text.isprintable():
        return text
    return "".join(
        each if each.isprintable() else each.encode("unicode_escape").decode() for each in text
    )


class BfrtError(Exception):
    """Stands for any fault that bfrt finds: the base of all its exceptions."""

    def __str__(self) -> str:
        return escaped(super().__str__())

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickle by the arguments: Dask's way to send errors on has none of its own for some."""
        return type(self), self.args


class SceneError(BfrtError, ValueError):
    """Reports input that is no scene: a bad file, a NaN, a count that the data do not bear out.

    It is a `ValueError` too.
    """


class StoreError(BfrtError, ValueError):
    """Reports a scene store that is truncated, damaged, of another version, or no store at all.

    It is a `ValueError` too.
    """


class CheckpointError(BfrtError, ValueError):
    """Reports a checkpoint that is damaged, or of another format.

    It is a `ValueError` too.
    """


class BudgetError(BfrtError, MemoryError):
    """Reports a memory budget below what the work needs; the message names the least that works.

    It is a `MemoryError` too.
    """


class ResourceError(BfrtError, MemoryError):
    """Reports memory or a thread that the system refused, though the budget has room for it.

    The message names what was asked for. It is a `MemoryError` too.
    """


class SettingError(BfrtError, ValueError):
    """Reports a setting or an argument that cannot be honoured.

    It is a `ValueError` too.
    """


class Cancelled(BfrtError):
    """Reports work that somebody ended: a callback that returned False, or a closed client."""


class StreamError(BfrtError, OSError):
    """Reports a read or a write that the system refused.

    It is an `OSError` too.

    Parameters
    ----------
    path : path-like
        The file.
    offset : int
        Where in the file, bytes.
    errno : int
        The system's number for the fault, as in the module `errno`.
    doing : str
        What was tried, for the message: "reading", "writing" ...

    Attributes
    ----------
    path : str
        The file.
    offset : int
        Where in the file, bytes.
    errno : int
        The system's number for the fault, as in the module `errno`.
    """

    def __init__(self, path: str | os.PathLike[str], offset: int, errno: int, doing: str) -> None:
        self.path = os.fspath(path)
        self.offset = offset
        self._doing = doing
        super().__init__(errno, f"{self.path}: {doing} at byte {offset}: {os.strerror(errno)}")

    def __str__(self) -> str:
        return escaped(str(self.args[1]))

    def about(self, path: str | os.PathLike[str]) -> StreamError:
        """Return the same error about another path: of what the file was to become."""
        assert self.errno is not None
        return type(self)(path, self.offset, self.errno, self._doing)

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickle by the arguments, so that a pool of processes can pass the error on."""
        return type(self), (self.path, self.offset, self.errno, self._doing)


class DiskFullError(StreamError):
    """Reports a write that finds no space left (ENOSPC, or a quota)."""


class ShortReadError(BfrtError, EOFError):
    """Reports a file that ends before a record that its header promises.

    It is an `EOFError` too.

    Parameters
    ----------
    path : path-like
        The file.
    offset : int
        Where the record begins, bytes.
    asked, left : int
        Bytes of the record, and bytes that the file has from there on.

    Attributes
    ----------
    path : str
        The file.
    offset : int
        Where the record begins, bytes.
    """

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
