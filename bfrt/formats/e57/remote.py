"""Columns of an E57 file that another process reads: `bfrt.formats.columns.Columns`."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from bfrt.formats.remote.process import Library, RemoteFile
from bfrt.formats.source import Report

E57 = Library("libE57Format", "bfrt.formats.e57.child", "an E57 file that is whole")

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

    Attributes
    ----------
    count : int
        Points of all scans.
    names : list of str
        Of all columns.

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
        self._file = RemoteFile(path, (), E57)
        self.count: int
        self.names: Sequence[str]
        self.count, *self.names = self._file.facts

    def columns(self, names: Sequence[str]) -> Iterator[NDArray[np.float64]]:
        """Yield columns of all scans, (n, len(names)), block by block; else as the class."""
        self._file.ask("begin", *names)
        done, most = 0, MOST_POINTS * len(names)
        while (block := self._file.numbers(["next"], self.dtype, most)) is not None:
            done += len(block)
            if self._report is not None:
                self._report(self._size * done // max(self.count, done, 1))
            yield block

    def full(self, _: Sequence[str]) -> float:
        """Return the number that means full color: the process scales them."""
        return 1.0

    def close(self) -> None:
        """End the process."""
        self._file.close()
