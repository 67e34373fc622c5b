"""Columns of a PCD file by the names of its fields: `bfrt.formats.columns.Columns`."""

from __future__ import annotations

import struct
from collections.abc import Callable, Iterator, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bfrt.errors import SceneError
from bfrt.formats.arrays import BLOCK_BYTES
from bfrt.formats.casting import cast
from bfrt.formats.colors import FULL_8, full_of
from bfrt.formats.lines.head import BLANK, Head
from bfrt.formats.lines.table import LineTable
from bfrt.formats.pcd._lzf import FEED_BYTES, Unpacker
from bfrt.formats.pcd.header import Field, Header
from bfrt.formats.points import POINTS_AT_ONCE
from bfrt.formats.reading import COLORS
from bfrt.formats.source import Source

#: Fields that have a color in the bits of one number, and where in it each part is.
PACKED_COLORS = ("rgb", "rgba")
SHIFTS = dict(zip(COLORS, (16, 8, 0), strict=True))

#: The name of fields that are room and nothing else.
PADDING = "_"

#: What is before packed columns: their bytes, and those that they become.
SIZES = struct.Struct("<II")

Blocks = Iterator[dict[str, NDArray[Any]]]


class PcdTable:
    """Reads the rows of an open PCD file."""

    def __init__(self, source: Source, header: Header) -> None:
        self.name = source.name
        self._source = source
        self._header = header
        self._start = header.start + (0 if header.layout == "ascii" else len(source.mark))
        single = [f for f in header.fields if f.numbers == 1 and f.name != PADDING]
        self._fields: dict[str, Field] = {field.name: field for field in reversed(single)}
        self._color: Field | None = next(
            (f for n in PACKED_COLORS if (f := self._fields.get(n)) and f.dtype.itemsize == 4), None
        )
        packed = COLORS if self._color is not None else ()
        own = [field.name for field in single]
        self.names: Sequence[str] = [*own, *(name for name in packed if name not in own)]
        places = [self._fields[axis].dtype for axis in "xyz" if axis in self._fields]
        narrow = all(np.can_cast(dtype, np.float32) for dtype in places)
        self.dtype = np.dtype("f4" if narrow else "f8")
        self._blocks: Callable[[list[Field]], Blocks] = {
            "ascii": self._of_text,
            "binary": self._of_bytes,
            "binary_compressed": self._of_packed,
        }[header.layout]
        if header.layout == "binary":
            self._check_size(header.rows * header.row_bytes, self._start)

    def _check_size(self, size: int, at: int) -> None:
        if self._source.size - at < size:
            raise SceneError(
                f"{self.name}: byte {at}: found {max(self._source.size - at, 0)} bytes, expected "
                f"{size} of {self._header.rows} rows: the file is truncated or its count is wrong"
            )

    def columns(self, names: Sequence[str]) -> Iterator[NDArray[np.float64]]:
        """Yield columns, (n, len(names)), block by block."""
        homes = {name: self._home(name) for name in names}
        fields = list(dict.fromkeys(homes.values()))
        for block in self._blocks(fields):
            values = [self._values(name, homes[name], block) for name in names]
            yield np.stack(values, axis=-1)

    def _home(self, name: str) -> Field:
        """Return the field that has a column's numbers."""
        if name in self._fields:
            return self._fields[name]
        assert self._color is not None
        return self._color

    def _values(self, name: str, field: Field, block: dict[str, NDArray[Any]]) -> NDArray[Any]:
        """Return a column: a field, or a part of the colors that are packed in one."""
        column = block[field.name]
        if name == field.name:
            return cast(column, np.float64)
        bits = np.ascontiguousarray(column).view(np.uint32)
        parts: NDArray[Any] = (bits >> SHIFTS[name] & 255).astype(np.float64)
        return parts

    def full(self, names: Sequence[str]) -> float:
        """Return the number that means full color."""
        if all(name in SHIFTS and name not in self._fields for name in names):
            return FULL_8
        dtype = np.result_type(*(self._home(name).dtype for name in names))
        return full_of(self.name, dtype, self.columns(names))

    def _of_text(self, fields: list[Field]) -> Blocks:
        names = [str(k) for f in self._header.fields for k in [f.name] * f.numbers]
        places: dict[str, str] = {}
        for place, name in enumerate(names):
            places.setdefault(name, f"of {place}")
        known = tuple(f"of {place}" for place in range(len(names)))
        head = Head(known, BLANK, self._start, self._header.line, self._header.rows)
        table = LineTable(self._source, head, titles=tuple(names))
        for block in table.columns([places[field.name] for field in fields]):
            yield {f.name: self._typed(block[:, k], f) for k, f in enumerate(fields)}

    def _typed(self, column: NDArray[np.float64], field: Field) -> NDArray[Any]:
        """Return numbers of text in their field's type, where their bits count."""
        if field is not self._color:
            return column
        with np.errstate(all="ignore"):
            if field.dtype.kind == "f":
                return column.astype(np.float32)
            whole: NDArray[Any] = np.nan_to_num(column).astype(np.int64).astype(np.uint32)
            return whole

    def _of_bytes(self, fields: list[Field]) -> Blocks:
        row = np.dtype(
            {
                "names": [field.name for field in fields],
                "formats": [field.dtype for field in fields],
                "offsets": [field.offset for field in fields],
                "itemsize": self._header.row_bytes,
            }
        )
        self._source.seek(self._start)
        most = max(1, min(POINTS_AT_ONCE, BLOCK_BYTES // row.itemsize))
        for block in self._source.blocks(row, self._header.rows, most):
            yield {field.name: block[field.name] for field in fields}

    def _of_packed(self, fields: list[Field]) -> Blocks:
        self._source.seek(self._start)
        packed, size = SIZES.unpack(self._source.exactly(SIZES.size))
        rows = self._header.rows
        if size != rows * self._header.row_bytes:
            raise SceneError(
                f"{self.name}: byte {self._start}: found columns of {size} bytes, expected "
                f"{rows * self._header.row_bytes} of {rows} rows: the count is wrong"
            )
        begin = self._start + SIZES.size
        self._check_size(packed, begin)
        cursors = [Cursor(self._source, begin, packed) for _ in fields]
        for cursor, field in zip(cursors, fields, strict=True):
            cursor.skip(field.offset * rows)
        while rows:
            n = min(rows, POINTS_AT_ONCE)
            yield {f.name: c.read(n, f.dtype) for c, f in zip(cursors, fields, strict=True)}
            rows -= n


class Cursor:
    """Unpacks a file's packed bytes from the begin on, beside others that do so."""

    def __init__(self, source: Source, begin: int, size: int) -> None:
        self._source = source
        self._at, self._end = begin, begin + size
        self._unpacker = Unpacker()

    def skip(self, size: int) -> None:
        """Pass over unpacked bytes."""
        buffer = np.empty(min(size, FEED_BYTES), np.uint8)
        while size:
            n = min(size, len(buffer))
            self._fill(buffer[:n])
            size -= n

    def read(self, count: int, dtype: np.dtype[Any]) -> NDArray[Any]:
        """Return the next numbers of a type.

        Raises
        ------
        SceneError
            If they are not what LZF packs, or end before.
        """
        buffer = np.empty(count * dtype.itemsize, np.uint8)
        self._fill(buffer)
        return buffer.view(dtype)

    def _fill(self, buffer: NDArray[np.uint8]) -> None:
        done = 0
        while done < len(buffer):
            got = self._unpacker.take(buffer[done:])
            done += got
            if not got:
                self._feed()

    def _feed(self) -> None:
        size = min(self._end - self._at, FEED_BYTES)
        if self._unpacker.failed or not size:
            found = "a reference before the first byte" if self._unpacker.failed else "the end"
            raise SceneError(
                f"{self._source.name}: byte {self._at}: found {found}, expected more of what LZF "
                "has packed"
            )
        self._source.seek(self._at)
        self._unpacker.feed(self._source.exactly(size).tobytes())
        self._at += size
