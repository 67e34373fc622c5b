"""Points of formats that have columns with names: where they are, how large, and of which color."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from bfrt.errors import SceneError, SettingError
from bfrt.formats.casting import cast
from bfrt.formats.points import PointBlock
from bfrt.formats.reading import COLORS, RGB, Reading
from bfrt.formats.source import printable

POSITION = ("x", "y", "z")

#: Names that radii, colors and types go by; of several the first counts.
RADII = ("radius", "radii")
COLOR_NAMES = (COLORS, ("r", "g", "b"))
TYPE = "type"


class Columns(Protocol):
    """Provides columns of numbers by their names, which can be read again and again.

    Attributes
    ----------
    name : str
        Name of the file, for errors.
    names : sequence of str
        Of all columns that may be asked for.
    dtype : numpy.dtype
        The type of positions: float32 or float64.
    """

    name: str
    names: Sequence[str]
    dtype: np.dtype[Any]

    def columns(self, names: Sequence[str]) -> Iterator[NDArray[Any]]:
        """Yield columns, (n, len(names)), block by block; a name may come twice."""
        ...

    def full(self, names: Sequence[str]) -> float:
        """Return the number that means full color in columns of colors."""
        ...


class ColumnPoints:
    """Makes points of columns: a `bfrt.formats.points.Points`.

    Raises
    ------
    SettingError
        If there is no column that a setting names.
    SceneError
        If there are no positions, or several columns have the name of one that is wanted.
    """

    def __init__(self, table: Columns, reading: Reading) -> None:
        self.name = table.name
        self._table = table
        if not all(name in table.names for name in POSITION):
            raise SceneError(
                f"{self.name}: found columns {listed(table.names)}, expected x, y and z"
            )
        self._asked = painting(table, reading)
        self._by_type = reading.radii
        self._radius = self._find_radius(reading)
        for name in (*self._radius, *self._asked):
            if name not in table.names:
                raise SettingError(
                    f"{self.name}: found no column {name!r}, expected one of {listed(table.names)}"
                )
        refuse_repeated(self.name, table.names, (*POSITION, *self._radius, *self._asked))
        self.painted = bool(self._asked)
        self._full = table.full(self._asked) if len(self._asked) == 3 else 1.0

    def _find_radius(self, reading: Reading) -> tuple[str, ...]:
        """Return the name of the column that tells radii, if one does."""
        if self._by_type is not None:
            return (TYPE,)
        if reading.radius_column is not None:
            return (reading.radius_column,)
        own = [name for name in RADII if name in self._table.names]
        return tuple(own[:1]) if reading.radius is None else ()

    def blocks(self) -> Iterator[PointBlock]:
        first = 3 + len(self._radius)
        for block in self._table.columns((*POSITION, *self._radius, *self._asked)):
            centers = cast(block[:, :3], self._table.dtype)
            yield PointBlock(
                centers,
                self._radii(block[:, 3]) if self._radius else None,
                self._values(block[:, first:]) if self._asked else None,
            )

    def _radii(self, column: NDArray[Any]) -> NDArray[Any]:
        """Return radii: a column as it is, or those of its types.

        Raises
        ------
        SettingError
            If a type has none.
        """
        if self._by_type is None:
            return column
        types, places = np.unique(column, return_inverse=True)
        for kind in types:
            if float(kind) not in self._by_type:
                raise SettingError(
                    f"{self.name}: found a point of type {float(kind):g}, expected its radius too "
                    f"in radius= (--radius), as in {float(kind):g}=1.5"
                )
        radii = np.array([self._by_type[float(kind)] for kind in types])
        found: NDArray[Any] = radii[places.reshape(-1)]
        return found

    def _values(self, columns: NDArray[Any]) -> NDArray[Any]:
        return columns[:, 0] if columns.shape[1] == 1 else columns / self._full

    def numbers(self) -> Iterator[NDArray[Any]]:
        return (self._values(block) for block in self._table.columns(self._asked))


def refuse_repeated(file: str, names: Sequence[str], wanted: Sequence[str]) -> None:
    """Refuse names that are wanted and that several columns have.

    Raises
    ------
    SceneError
    """
    for name in wanted:
        count = names.count(name)
        if count > 1:
            raise SceneError(
                f"{file}: found {count} columns named {printable(name)}, expected one of that name"
            )


def combined(places: NDArray[np.float64], rows: NDArray[np.float64]) -> NDArray[np.float64]:
    """Multiply places (n, 3) by a matrix (3, 3), with the same bits on every processor.

    A library of linear algebra would fuse additions where it can.
    """
    found: NDArray[np.float64] = places[:, :1] * rows[0]
    for axis in (1, 2):
        found += places[:, axis, None] * rows[axis]
    return found


def painting(table: Columns, reading: Reading) -> tuple[str, ...]:
    """Return the names of the columns that colors are made from."""
    for names in COLOR_NAMES if reading.color_by == RGB else ():
        if all(name in table.names for name in names):
            return names
    return reading.columns


def listed(names: Sequence[str], most: int = 40) -> str:
    """List names of columns for an error."""
    shown = [printable(name)[:40] for name in names[:most]]
    return " ".join([*shown, "..."] if len(names) > most else shown) or "none"
