"""Columns of an E57 file that another process reads: `bfrt.formats.columns.Columns`."""

from __future__ import annotations

import contextlib
import io
import json
import os
import subprocess
import sys
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bfrt.errors import SceneError
from bfrt.formats.hdf5.messages import Channel, Ended, bytes_of
from bfrt.formats.source import Report
from bfrt.refusals import calling, give_up, refused

#: What the process does. It has modules from where they are here, not from the working folder,
#: which may have sources of the same names.
SERVE = """
import json, sys
sys.path[:] = sys.argv[2:]
from bfrt.formats.e57.child import main
main(json.loads(sys.argv[1]))
"""

#: Points of a block, at the most: what the process sends that is more is none.
MOST_POINTS = 1 << 20


class RemoteTable:
    """Asks a process of its own for the columns of an E57 file.

    Parameters
    ----------
    path : str
    size : int
        Bytes of the file, for `report`.
    report : callable, optional
        Called with the bytes that are read, as they are spread over the points.

    Raises
    ------
    SceneError
        If it is no E57 file, or one that is broken, or that ends the library.
    StreamError
        If the system refuses to start a process.
    """

    dtype = np.dtype("f8")

    def __init__(self, path: str, size: int, report: Report | None = None) -> None:
        self.name = path
        self._size = size
        self._report = report
        self._process: subprocess.Popen[bytes] | None = None
        self.names: Sequence[str] = ()
        try:
            self.count, *names = self._start()
            self.names = names
        except BaseException:
            self.close()
            raise

    def columns(self, names: Sequence[str]) -> Iterator[NDArray[np.float64]]:
        """Yield columns of all scans, (n, len(names)), block by block; else as the class."""
        if self._process is None:
            self._start()
        done, ended = 0, False
        try:
            with self._asking():
                self._channel.send(list(names))
            while (block := self._block(len(names))) is not None:
                done += len(block)
                if self._report is not None:
                    self._report(self._size * done // max(self.count, done, 1))
                yield block
            ended = True
        finally:
            if not ended:  # what is still to come is for nobody
                self.close()

    def full(self, _: Sequence[str]) -> float:
        """Return the number that means full color: the process scales them."""
        return 1.0

    def close(self) -> None:
        """End the process."""
        if self._process is not None:
            for pipe in (self._process.stdin, self._process.stdout):
                assert pipe is not None
                give_up(pipe)
            self._process.kill()
            self._process.wait()
            self._process = None

    def _start(self) -> list[Any]:
        """Start the process; return what it says of the file."""
        there = [os.path.abspath(folder) for folder in sys.path]  # noqa: PTH100
        work = [sys.executable, "-c", SERVE, json.dumps(self.name), *there]
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
        self._channel = Channel(self._process.stdout, self._process.stdin)
        with self._asking():
            return self._words("done")[0][1:]

    def _block(self, columns: int) -> NDArray[np.float64] | None:
        """Receive the next block of a pass, or None at its end."""
        with self._asking():
            words, behind = self._words("block", "end")
            if words[0] == "end":
                return None
            rows = words[1]
            if not 0 <= rows <= MOST_POINTS or behind != rows * columns * 8:
                raise Ended
            block = np.empty((rows, columns))
            self._channel.fill(bytes_of(block))
        return block

    def _words(self, *expected: str) -> tuple[list[Any], int]:
        """Receive an answer; raise the error that it may be instead."""
        words, behind = self._channel.receive()
        if words[0] in expected:
            return words, behind
        if words[0] == "SceneError":
            raise SceneError(words[1])
        if words[0] == "MemoryError":
            raise MemoryError("in the process that reads E57")
        raise RuntimeError(*words[1:])

    @contextlib.contextmanager
    def _asking(self) -> Iterator[None]:
        """Have an error told where the process has ended, by what it reads or by the system."""
        try:
            with calling(self.name, "reading"):
                yield
        except Ended:
            assert self._process is not None
            status = self._process.wait()
            raise SceneError(
                f"{self.name}: found what ends libE57Format itself (status {status}), expected an "
                "E57 file that is whole"
            ) from None
