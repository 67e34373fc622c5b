"""A file that another process reads, which is asked for what is in it."""

from __future__ import annotations

import contextlib
import fcntl
import importlib.util
import io
import json
import math
import os
import subprocess
import sys
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from bfrt.errors import (
    BudgetError,
    SceneError,
    SettingError,
    ShortReadError,
    StreamError,
)
from bfrt.formats.remote.messages import Channel, Ended, bytes_of
from bfrt.refusals import calling, give_up, refused

#: What the process does. It has modules from where they are here, not from the working folder,
#: which may have sources of the same names.
SERVE = """
import json, sys
from importlib import import_module
sys.path[:] = sys.argv[3:]
import_module(sys.argv[2]).main(*json.loads(sys.argv[1]))
"""

#: The errors that it may answer with.
ERRORS: dict[str, type[Exception]] = {
    kind.__name__: kind
    for kind in (
        BudgetError, KeyError, RuntimeError, SceneError, SettingError, ShortReadError, StreamError,
    )
}  # fmt: skip

#: Bytes that a pipe holds, so that the processes seldom wait for one another.
PIPE_BYTES = 1 << 20


class Library(NamedTuple):
    """Names a library that reads in a process of its own.

    Attributes
    ----------
    name : str
    module : str
        The module whose `main` the process runs, with the path and what limits it.
    whole : str
        What a file is expected to have that does not end it.
    """

    name: str
    module: str
    whole: str


class RemoteFile:
    """Asks a process of its own for what a file has.

    Parameters
    ----------
    path : str
        The file.
    limits : tuple
        What JSON has: what the process may take.
    library : Library
        What reads it there.

    Attributes
    ----------
    facts : list
        What the process says first: what is in the file.

    Raises
    ------
    SceneError
        If the file is none of the library's, or is broken, or ends the library itself.
    StreamError
        If the system refuses to read it, or to start a process.
    """

    def __init__(self, path: str, limits: tuple[Any, ...], library: Library) -> None:
        self.path = path
        self._library = library
        there = [os.path.abspath(folder) for folder in sys.path]  # noqa: PTH100
        words = json.dumps([path, limits])
        work = [sys.executable, "-c", SERVE, words, library.module, *there]
        pipes: dict[str, Any] = dict.fromkeys(("stdin", "stdout"), subprocess.PIPE)
        try:
            # A session of its own: a key that interrupts this process is not for that one.
            self._process = subprocess.Popen(
                work, bufsize=0, stderr=subprocess.DEVNULL, start_new_session=True, **pipes
            )
        except OSError as error:
            raise refused(sys.executable, 0, error, "starting") from error
        assert isinstance(self._process.stdin, io.FileIO)
        assert isinstance(self._process.stdout, io.FileIO)
        widen(self._process.stdout)
        self._channel = Channel(self._process.stdout, self._process.stdin)
        try:
            with calling(path, "reading"):
                self.facts: list[Any] = self._answer()
        except BaseException:
            self.close()
            raise

    def ask(self, *request: Any) -> list[Any]:
        """Return the words of an answer.

        Raises
        ------
        KeyError, SceneError, SettingError, BudgetError, ShortReadError, StreamError
            As the answer says; SceneError if there is none, for the process has ended.
        """
        with calling(self.path, "reading"):
            try:
                self._channel.send(list(request))
            except Ended:
                raise self._ended() from None
            return self._answer()

    def numbers(self, request: list[Any], dtype: np.dtype[Any], most: int) -> NDArray[Any] | None:
        """Return the numbers of an answer, `most` at the most, or None for none; else as `ask`."""
        with calling(self.path, "reading"):
            try:
                self._channel.send(request)
                words, behind = self._channel.receive()
                _raise_error(words)
                if words[1] is None:
                    return None
                if math.prod(words[1]) > most or behind != math.prod(words[1]) * dtype.itemsize:
                    raise Ended
                block = np.empty(words[1], dtype)
                self._channel.fill(bytes_of(block))
            except Ended:
                raise self._ended() from None
        return block

    def close(self) -> None:
        """End the process."""
        for pipe in (self._process.stdin, self._process.stdout):
            assert pipe is not None
            give_up(pipe)  # what was said through it has been read, or is for nobody
        self._process.kill()
        self._process.wait()

    def _answer(self) -> list[Any]:
        """Receive an answer without bytes behind it; else as `ask`."""
        try:
            words, _ = self._channel.receive()
            _raise_error(words)
        except Ended:
            raise self._ended() from None
        return words[1:]

    def _ended(self) -> SceneError:
        """Return an error for a process that has ended."""
        status = self._process.wait()
        return SceneError(
            f"{self.path}: found what ends {self._library.name} itself (status {status}), expected "
            f"{self._library.whole}"
        )


def widen(pipe: io.FileIO) -> None:
    """Have a pipe hold more bytes, where the system can."""
    with contextlib.suppress(AttributeError, OSError):  # it is only slower
        fcntl.fcntl(pipe.fileno(), fcntl.F_SETPIPE_SZ, PIPE_BYTES)


def _raise_error(words: list[Any]) -> None:
    """Raise the error that an answer is, if it is one."""
    kind, *made = words
    if kind == "MemoryError":
        raise MemoryError("in the process that reads the file")
    if kind != "done":
        if kind not in ERRORS:
            raise Ended
        raise ERRORS[kind](*made)


def is_installed(module: str) -> bool:
    """Tell whether a module can be imported, without doing so."""
    try:
        return sys.modules.get(module) is not None or importlib.util.find_spec(module) is not None
    except ValueError:  # it is None there
        return False
