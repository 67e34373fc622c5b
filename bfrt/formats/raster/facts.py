"""What a raster says of itself: its size, where it lies, and how it is read."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

from bfrt.errors import SceneError
from bfrt.store.header import LARGEST


class Place(NamedTuple):
    """Says where a raster lies: what a raster that is made from it has as well.

    Attributes
    ----------
    width, height : int
        Heights a row, and rows.
    transform : tuple of 6 float
        a, b, c, d, e, f: the corner of column i and row j is at x = a i + b j + c and
        y = d i + e j + f.
    crs : str
        The reference system, as "EPSG:32632", or in WKT where no number has it; empty if none.
    """

    width: int
    height: int
    transform: tuple[float, float, float, float, float, float]
    crs: str

    @property
    def determinant(self) -> float:
        """Return the area of a cell, below 0 where rows and columns turn against x and y."""
        a, b, _, d, e, _ = self.transform
        return a * e - b * d

    def at(self, column: float, row: float) -> tuple[float, float]:
        """Return x and y of a place that columns and rows count to, from the first corner."""
        a, b, c, d, e, f = self.transform
        return a * column + b * row + c, d * column + e * row + f

    def cell_of(self, x: float, y: float) -> tuple[float, float]:
        """Return the column and the row of x and y, as `at` takes them."""
        a, b, c, d, e, f = self.transform
        x, y = x - c, y - f
        return (e * x - b * y) / self.determinant, (a * y - d * x) / self.determinant

    @property
    def middle(self) -> tuple[float, float]:
        """Return x and y of the raster's middle."""
        return self.at(self.width / 2, self.height / 2)


class Facts(NamedTuple):
    """Holds what a raster says of itself.

    Attributes
    ----------
    place : Place
    dtype : str
        The type of its numbers.
    rows : int
        Rows that are read at once: those of a block, or as many as memory has room for.
    scale, offset : float
        What makes heights of numbers.
    degrees : bool
        Whether x and y are degrees.
    radius : float
        The larger half axis of the reference system's ellipsoid, in units of x and y.
    fill : float, optional
        The number that stands for no data, where there is one.
    """

    place: Place
    dtype: str
    rows: int
    scale: float
    offset: float
    degrees: bool
    radius: float
    fill: float | None

    @classmethod
    def of_words(cls, words: list[Any]) -> Facts:
        """Return the facts that JSON has as lists."""
        (width, height, transform, crs), *rest = words
        return cls(Place(width, height, tuple(transform), crs), *rest)


def check_place(name: str, place: Place) -> None:
    """Refuse a raster without cells, or whose corners are nowhere.

    Raises
    ------
    SceneError
    """
    if min(place.width, place.height) < 2:
        raise SceneError(
            f"{name}: found {place.width} x {place.height} heights, expected 2 x 2 or more: cells "
            "are between four"
        )
    ends = [place.at(i, j) for i in (0, place.width) for j in (0, place.height)]
    found = [*place.transform, place.determinant, *(abs(x) for end in ends for x in end)]
    if not all(map(math.isfinite, found)) or max(found) > LARGEST or not place.determinant:
        raise SceneError(
            f"{name}: found the transform {' '.join(f'{x:g}' for x in place.transform)}, expected "
            "one that has cells of some area, at places that float32 has"
        )
