"""Elements of a PLY file: rows that have the same properties, and what is wanted of them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from bfrt.formats.source import printable

#: Types of values by both of their names, in the order of _rows'. Integers of 64 bits are no
#: standard, but there are writers of them.
TYPES = {
    "char": 0, "uchar": 1, "short": 2, "ushort": 3, "int": 4, "uint": 5, "float": 6, "double": 7,
    "int8": 0, "uint8": 1, "int16": 2, "uint16": 3, "int32": 4, "uint32": 5, "float32": 6,
    "float64": 7, "int64": 8, "uint64": 9,
}  # fmt: skip
CODES = ("i1", "u1", "i2", "u2", "i4", "u4", "f4", "f8", "i8", "u8")
WHOLE = (0, 1, 2, 3, 4, 5, 8, 9)

#: Types that a float32 holds exactly.
NARROW = (0, 1, 2, 3, 6)

CORNERS = ("vertex_indices", "vertex_index")


class Property(NamedTuple):
    """Describes a column; `counted` is the type of a list's count, or -1."""

    name: str
    kind: int
    counted: int = -1


class Wanted(NamedTuple):
    """Says what is wanted of an element's rows.

    Attributes
    ----------
    columns : tuple of int
        Where each property goes: a column, or -1; of the list of corners `width`.
    width : int
        Columns.
    strips : bool
        Whether that list is a strip of triangles, in which -1 begins a new one.
    """

    columns: tuple[int, ...]
    width: int
    strips: bool = False


class Element(NamedTuple):
    """Describes an element: a number of rows that have the same properties."""

    name: str
    rows: int
    properties: tuple[Property, ...]

    @property
    def shown(self) -> str:
        """Return its name for errors."""
        return printable(self.name)

    def least_bytes(self, layout: str) -> int:
        """Return the least bytes of a row: of a list its count; of text two a value."""
        if layout == "text":
            return 2 * len(self.properties)
        kinds = [p.kind if p.counted < 0 else p.counted for p in self.properties]
        return sum(int(CODES[kind][1]) for kind in kinds)

    @property
    def row_bytes(self) -> int | None:
        """Return the bytes of a row, or None where rows differ."""
        if any(p.counted >= 0 for p in self.properties):
            return None
        return sum(int(CODES[p.kind][1]) for p in self.properties)

    @property
    def has_strips(self) -> bool:
        """Tell whether the lists of corners are strips of triangles."""
        return self.name == "tristrips"

    def find(self, name: str) -> Property | None:
        """Find a property by its name, unless it is a list."""
        return next((p for p in self.properties if p.name == name and p.counted < 0), None)

    def corners(self) -> Property | None:
        """Find the property that lists a face's vertices."""
        return next((p for p in self.properties if p.name in CORNERS and p.counted >= 0), None)

    def row_dtype(self, layout: str, names: Sequence[str]) -> np.dtype[Any]:
        """Make the dtype of rows without lists, with the fields that are wanted."""
        order = "<" if layout == "little" else ">"
        codes = [CODES[p.kind] for p in self.properties]
        ends = np.cumsum([int(code[1]) for code in codes]).tolist()
        place = {p.name: number for number, p in enumerate(self.properties)}
        wanted = [place[name] for name in dict.fromkeys(names)]
        return np.dtype(
            {
                "names": [self.properties[number].name for number in wanted],
                "formats": [order + codes[number] for number in wanted],
                "offsets": [ends[number] - int(codes[number][1]) for number in wanted],
                "itemsize": ends[-1],
            }
        )

    def dtype_of(self, names: Sequence[str]) -> np.dtype[Any]:
        """Return float32 if it holds the columns exactly, else float64."""
        kinds = [found.kind for name in names if (found := self.find(name))]
        return np.dtype("f4" if all(kind in NARROW for kind in kinds) else "f8")

    def wanted(self, names: Sequence[str], corners: Property | None) -> Wanted:
        """Say where the properties go: columns in the order of `names`, and a list of corners."""
        columns = {self.find(name): column for column, name in enumerate(names)}
        return Wanted(
            tuple(len(names) if p is corners else columns.get(p, -1) for p in self.properties),
            len(names),
            corners is not None and self.has_strips,
        )
