"""Arrays of an HDF5 file that another process reads: `bfrt.formats.table.Arrays`."""

from __future__ import annotations

import contextlib
import fcntl
import io
import json
import math
import os
import subprocess
import sys
from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bfrt.errors import (
    BudgetError,
    SceneError,
    SettingError,
    ShortReadError,
    StreamError,
)
from bfrt.formats.hdf5.messages import Channel, Ended, bytes_of, type_of_words
from bfrt.formats.table import Array
from bfrt.refusals import calling, give_up, refused

#: What the process does. It has modules from where they are here, not from the working folder,
#: which may have sources of the same names.
SERVE = """
import json, sys
sys.path[:] = sys.argv[2:]
from bfrt.formats.hdf5.child import main
main(*json.loads(sys.argv[1]))
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


class RemoteFile:
    """Asks a process of its own for what an HDF5 file has.

    Parameters
    ----------
    path : str
        The file.
    limits : tuple
        What `bfrt.formats.hdf5.origins.Limits` has.

    Raises
    ------
    SceneError
        If it is no HDF5 file, or one that is broken, or that ends HDF5 itself.
    StreamError
        If the system refuses to read it, or to start a process.
    """

    def __init__(self, path: str, limits: tuple[Any, ...]) -> None:
        self.path = path
        there = [os.path.abspath(folder) for folder in sys.path]  # noqa: PTH100
        work = [sys.executable, "-c", SERVE, json.dumps([path, limits]), *there]
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
                self.names: list[str] = self._answer()
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

    def rows(self, begun: int, dtype: np.dtype[Any], most: int) -> NDArray[Any] | None:
        """Return the next rows of a pass, of `most` numbers at the most, or None; else as `ask`."""
        with calling(self.path, "reading"):
            try:
                self._channel.send(["next", begun])
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
            f"{self.path}: found what ends HDF5 itself (status {status}), expected datasets that "
            "are whole"
        )


def widen(pipe: io.FileIO) -> None:
    """Have a pipe hold more bytes, where the system can."""
    with contextlib.suppress(AttributeError, OSError):  # it is only slower
        fcntl.fcntl(pipe.fileno(), fcntl.F_SETPIPE_SZ, PIPE_BYTES)


def _raise_error(words: list[Any]) -> None:
    """Raise the error that an answer is, if it is one."""
    kind, *made = words
    if kind == "MemoryError":
        raise MemoryError("in the process that reads HDF5")
    if kind != "done":
        if kind not in ERRORS:
            raise Ended
        raise ERRORS[kind](*made)


class RemoteArray:
    """Reads an array of the file: a `bfrt.formats.table.Array`."""

    def __init__(
        self, file: RemoteFile, number: int, name: str, shape: list[int], dtype: Any
    ) -> None:
        self.name = name
        self.shape: tuple[int, ...] = tuple(shape)
        self.dtype = type_of_words(dtype)
        self._file, self._number = file, number

    def blocks(self, rows: int) -> Iterator[NDArray[Any]]:
        """Yield all rows, `rows` at a time."""
        (begun,) = self._file.ask("begin", self._number, rows)
        most = rows * math.prod(self.shape[1:])
        while (block := self._file.rows(begun, self.dtype, most)) is not None:
            yield block
        self._file.ask("end", begun)

    def shallow(self) -> RemoteArray:
        """Return the last frame of (frames, n, 3), as (n, 3)."""
        return self.frame(-1)

    def frame(self, number: int) -> RemoteArray:
        """Return a frame of (frames, n, 3), as (n, 3)."""
        return RemoteArray(self._file, *self._file.ask("frame", self._number, number))


class RemoteArrays(Mapping[str, Array]):
    """Maps paths to the arrays of a file, as `bfrt.formats.hdf5.datasets.Datasets` does there.

    Parameters and errors are those of `RemoteFile`.
    """

    def __init__(self, path: str, limits: tuple[Any, ...]) -> None:
        self._file = RemoteFile(path, limits)
        self._listed = dict.fromkeys(self._file.names)

    def close(self) -> None:
        """End the process that reads."""
        self._file.close()

    def attributes(self, path: str, *names: str) -> dict[str, Any] | None:
        """Return those attributes of some names that an object has; None if there is no object."""
        found: dict[str, Any] | None = self._file.ask("attributes", path, *names)[0]
        return found

    def __iter__(self) -> Iterator[str]:
        return iter(self._listed)

    def __len__(self) -> int:
        return len(self._listed)

    def __contains__(self, name: object) -> bool:
        if name in self._listed:
            return True
        return isinstance(name, str) and bool(self._file.ask("has", name)[0])

    def __getitem__(self, name: str) -> Array:
        return RemoteArray(self._file, *self._file.ask("open", name))
