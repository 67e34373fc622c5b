"""An open PLY file: its elements, which are read as often as needed."""

from __future__ import annotations

import logging
import os
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bfrt.errors import SceneError
from bfrt.formats.casting import cast
from bfrt.formats.ply._rows import Fault, Rows
from bfrt.formats.ply.element import Element, Property
from bfrt.formats.ply.header import Place, read_header
from bfrt.formats.source import CHUNK_BYTES, Report, Source, quoted
from bfrt.formats.text import MOST_CORNERS

log = logging.getLogger(__name__)

#: Rows of one size that are read at once, and their bytes unless one row has more.
ROWS_AT_ONCE = 1 << 16
BLOCK_BYTES = 32 << 20


class Ply:
    """Reads an open PLY file: its header, and its elements as often as needed."""

    def __init__(self, path: str | os.PathLike[str], report: Report | None = None) -> None:
        self.source = Source(path, report)
        self.name = self.source.name
        try:
            self.layout, self.elements, start = read_header(self.source)
            self._check_counts(start.offset)
        except BaseException:
            self.source.close()
            raise
        self._places = [start]
        self._left = 0  # bytes of a chunk that the next begins with

    def element(self, name: str) -> Element | None:
        return next((e for e in self.elements if e.name == name), None)

    def _place(self, number: int) -> Place:
        """Return the place where an element begins; read those before it where necessary."""
        while len(self._places) <= number:
            element, place = self.elements[len(self._places) - 1], self._places[-1]
            size = element.row_bytes
            if element.properties and (self.layout == "text" or size is None):
                for _ in self._parsed(len(self._places) - 1, (), None):
                    pass
            else:
                end = place.offset + element.rows * (size or 0)
                self._check_size(element, place.offset, end)
                self._places.append(Place(end, place.line))
        return self._places[number]

    def _check_counts(self, start: int) -> None:
        """Refuse counts that no such file has room for, before anything is made for them."""
        for element in self.elements:
            least = element.rows * element.least_bytes(self.layout)
            self._check_size(element, start, start + max(least - 1, 0))  # no blank at the end

    def _check_size(self, element: Element, start: int, end: int) -> None:
        size = self.source.most_text if self.layout == "text" else self.source.size
        if end > size:
            raise SceneError(
                f"{self.name}: byte {start}: found {max(size - start, 0)} bytes, "
                f"expected {end - start} or more for {element.rows} rows of {element.shown}: "
                "the file is truncated or its count is wrong"
            )

    def columns(self, element: Element, names: Sequence[str]) -> Iterator[NDArray[Any]]:
        """Yield columns of an element, (n, len(names)), of the type that its `dtype_of` tells."""
        number = self.elements.index(element)
        dtype = element.dtype_of(names)
        if self.layout == "text" or element.row_bytes is None:
            for _, _, values in self._parsed(number, names, None):
                yield cast(values, dtype)
            return
        start = self._place(number).offset
        self._place(number + 1)  # all of it is there
        rows = element.row_dtype(self.layout, names)
        most = max(1, min(ROWS_AT_ONCE, BLOCK_BYTES // rows.itemsize))
        self.source.seek(start)
        for block in self.source.blocks(rows, element.rows, most):
            out = np.empty((len(block), len(names)), dtype)
            for column, name in enumerate(names):
                out[:, column] = block[name]
            yield out

    def faces(
        self, element: Element, names: Sequence[str]
    ) -> Iterator[tuple[NDArray[np.int64], NDArray[np.uint32], NDArray[Any]]]:
        """Yield the corners of faces or strips, their counts, and columns beside them."""
        return self._parsed(self.elements.index(element), names, element.corners())

    def _parsed(
        self, number: int, names: Sequence[str], corners: Property | None
    ) -> Iterator[tuple[NDArray[np.int64], NDArray[np.uint32], NDArray[Any]]]:
        """Parse an element's rows in order; note at the end where the next element begins."""
        element, place = self.elements[number], self._place(number)
        once = list(dict.fromkeys(names))  # a property may be wanted twice, z as color too
        places = [once.index(name) for name in names]
        rows = Rows(element, element.wanted(once, corners), self.layout, place.line)
        at = place.offset
        for chunk in self.source.text(at) if self.layout == "text" else self._binary(at):
            indices, counts, values, used = rows.parse(chunk)
            if rows.fault:
                raise self._fault(element, rows, at)
            at += used
            if len(indices) or len(counts):
                yield indices, counts, values if once == list(names) else values[:, places]
            if rows.done:
                break
            self._left = len(chunk) - used
        if not rows.done:
            raise SceneError(
                f"{self.name}: found the file's end in row {rows.row} of {element.shown}, expected "
                f"{element.rows} rows: the file is truncated or its count is wrong"
            )
        if len(self._places) == number + 1:
            self._places.append(Place(at, rows.line))

    def _binary(self, at: int) -> Iterator[NDArray[np.uint8]]:
        """Yield chunks of bytes from a place on; the unused end of one begins the next."""
        self.source.seek(at)
        buffer = np.empty(8 + CHUNK_BYTES, np.uint8)
        left = 0
        while got := self.source.read_into(buffer.data[left : left + CHUNK_BYTES]):
            end = left + got
            self._left = 0
            yield buffer[:end]
            left = self._left
            buffer[:left] = buffer[end - left : end].copy()

    def check_end(self) -> None:
        """Warn of bytes or text behind the last element."""
        end = self._place(len(self.elements))
        left = self.source.size - end.offset
        if self.layout == "text":
            left = self.source.text_left(end.offset)
        if left:
            log.warning(
                "%s: %d bytes behind the last element were passed over: its counts may be wrong",
                self.name,
                left,
            )

    def _fault(self, element: Element, rows: Rows, at: int) -> SceneError:
        where = f"line {rows.line}: " if self.layout == "text" else ""
        row = f"row {rows.row} of {element.shown}"
        found = quoted(rows.token) if self.layout == "text" else f"{rows.found:.15g}"
        messages = {
            Fault.BAD_NUMBER: f"found {found} in {row}, expected a number",
            Fault.NEGATIVE_COUNT: f"found {found} in {row}, expected a list's count, 0 or more",
            Fault.NO_INDEX: f"found {found} in {row}, expected a vertex's whole number",
            Fault.LONG_FACE: f"found {found} corners in {row}, expected {MOST_CORNERS} or fewer",
        }
        return SceneError(f"{self.name}: {where}{messages[Fault(rows.fault)]}")

    def __enter__(self) -> Ply:
        return self

    def __exit__(self, *_: object) -> None:
        self.source.close()
