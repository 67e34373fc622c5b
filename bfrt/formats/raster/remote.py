"""A raster that another process reads: what it says of itself, and its heights by rows."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from bfrt.formats.casting import cast
from bfrt.formats.raster.facts import Facts
from bfrt.formats.remote.process import Library, RemoteFile

GDAL = Library("GDAL", "bfrt.formats.raster.child", "a raster that is whole")


class Rows(NamedTuple):
    """Holds some rows of heights.

    Attributes
    ----------
    first : int
        Number of the first.
    heights : (rows, width) float64
    there : (rows, width) bool
        Which of them there are.
    """

    first: int
    heights: NDArray[np.float64]
    there: NDArray[np.bool_]


class RemoteRaster:
    """Reads one band of a raster.

    Parameters
    ----------
    path : str
    band : int
        Its number, from 1.
    taken, room : int
        Bytes of the budget: those that other things take, and those that blocks and rows may.

    Attributes
    ----------
    facts : Facts

    Raises
    ------
    SceneError
        If it is no raster, or is broken.
    SettingError
        If it has no such band.
    BudgetError
        If its blocks are larger than the room.
    StreamError
        If the system refuses to read it, or to start a process.
    """

    def __init__(self, path: str, band: int, taken: int, room: int) -> None:
        self._file = RemoteFile(path, (band, taken, room), GDAL)
        self.facts = Facts.of_words(self._file.facts)
        self._dtype = np.dtype(self.facts.dtype)

    def close(self) -> None:
        """End the process that reads."""
        self._file.close()

    def rows(self, first: int, count: int) -> Rows:
        """Return some rows; else as `RemoteFile.ask`."""
        most = count * self.facts.place.width
        numbers = self._file.numbers(["rows", first, count], self._dtype, most)
        there = self._file.numbers(["there"], np.dtype(np.uint8), most)
        assert numbers is not None
        with np.errstate(all="ignore"):  # what is not finite is told with its place
            heights = cast(numbers, np.float64)
            if (self.facts.scale, self.facts.offset) != (1.0, 0.0):
                heights = heights * self.facts.scale + self.facts.offset
        found = np.ones(heights.shape, np.bool_) if there is None else there != 0
        return Rows(first, heights, found)

    def all_rows(self) -> Iterator[Rows]:
        """Yield all rows, as many at a time as are read at once."""
        height = self.facts.place.height
        for first in range(0, height, self.facts.rows):
            yield self.rows(first, min(self.facts.rows, height - first))
