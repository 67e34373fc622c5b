"""Columns of text by their names: `bfrt.formats.columns.Columns`."""

from __future__ import annotations

import itertools
import re
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bfrt.errors import SceneError
from bfrt.formats.colors import full_of
from bfrt.formats.lines._lines import Columns, Fault
from bfrt.formats.lines.head import Head, ends_in
from bfrt.formats.lines.mistaken import in_place_of_comma
from bfrt.formats.points import POINTS_AT_ONCE
from bfrt.formats.source import Source, printable, quoted

#: What may be behind the last row: blanks, ends of lines, and comments.
NOTHING = re.compile(rb"(?:[ \t\r\n\v\f]+|#[^\r\n]*)*")


class LineTable:
    """Reads the rows of a text, which have the same columns.

    Parameters
    ----------
    source : Source
    head : Head
    behind : bytes
        What begins a line behind the rows; without it the file ends there.
    titles : tuple of str, optional
        What errors call columns, if not by their names.
    """

    dtype = np.dtype("f8")

    def __init__(
        self, source: Source, head: Head, behind: bytes = b"", titles: tuple[str, ...] = ()
    ) -> None:
        self.name = source.name
        self.names: Sequence[str] = Names(head.names)
        self._source = source
        self._head = head
        self._behind = behind
        self._titles = titles or head.names

    def columns(self, names: Sequence[str]) -> Iterator[NDArray[Any]]:
        """Yield columns, (n, len(names)), block by block.

        Raises
        ------
        SceneError
            If a row has other columns, or what is no number, or there are not as many rows as was
            promised.
        """
        head = self._head
        once = list(dict.fromkeys(map(self.names.index, names)))
        places = [once.index(k) if k in once else -1 for k in range(len(head.names))]
        wanted = [once.index(self.names.index(name)) for name in names]
        promised = -1 if head.rows is None else head.rows
        lines = Columns(places, len(once), head.separator, head.line, promised)
        chunks = self._source.text(head.start, lines=True)
        for chunk in chunks:
            values, used = lines.parse(chunk)
            if lines.fault:
                raise self._fault(lines)
            for first in range(0, len(values), POINTS_AT_ONCE):
                block = values[first : first + POINTS_AT_ONCE]
                yield block if wanted == [*range(len(once))] else block[:, wanted]
            if lines.done:
                self._check_end(itertools.chain([chunk], chunks), 1 + used, lines)
                break
        if head.rows is not None and not lines.done:
            raise SceneError(
                f"{self.name}: found {lines.rows} rows, expected {head.rows}: the file is "
                "truncated or its count is wrong"
            )

    def _check_end(self, chunks: Iterator[NDArray[Any]], at: int, lines: Columns) -> None:
        """Refuse a table that has more rows than was promised, from a byte of a chunk on."""
        line = lines.line
        for chunk in chunks:
            text = chunk[:-1].tobytes()
            end = NOTHING.match(text, at).end()  # type: ignore[union-attr]  # of any text
            line += ends_in(text, at, end)
            if end < len(text):
                break
            at = 1
        else:
            return
        if not (self._behind and text.startswith(self._behind, end)):
            raise SceneError(
                f"{self.name}: line {line}: found {quoted(text[end:].splitlines()[0])} behind "
                f"{lines.rows} rows, expected no more: the count is wrong"
            )

    def full(self, names: Sequence[str]) -> float:
        """Return the number that means full color: of 8 or of 16 bits, or 1, by a pass."""
        blocks = (np.nan_to_num(block, posinf=0.0) for block in self.columns(names))
        return full_of(self.name, np.dtype("i8"), blocks)

    def _fault(self, lines: Columns) -> SceneError:
        names = self._titles
        if lines.fault == Fault.OTHER_COLUMNS:
            told = f"found {lines.found} columns, expected {len(names)} as before"
        else:
            name = printable(names[lines.found])
            told = f"found {quoted(lines.token)}, expected the number of {name}"
            told += in_place_of_comma(lines.token)
        return SceneError(f"{self.name}: line {lines.line}: {told}")


class Names(Sequence[str]):
    """Lists the names of columns, each of which also goes by its number, from 1, in any case.

    Parameters
    ----------
    names : tuple of str
        In lower case.
    """

    def __init__(self, names: tuple[str, ...]) -> None:
        self._names = names

    def __getitem__(self, place: Any) -> Any:
        return self._names[place]

    def __len__(self) -> int:
        return len(self._names)

    def __contains__(self, name: object) -> bool:
        return isinstance(name, str) and self._find(name) is not None

    def index(self, name: str, *_: int) -> int:
        """Return the place of the first column of a name."""
        found = self._find(name)
        if found is None:
            raise ValueError(f"no column {name!r}")
        return found

    def count(self, name: str) -> int:
        """Return how many columns have a name."""
        return self._names.count(name.lower())

    def _find(self, name: str) -> int | None:
        lower = name.lower()
        if lower in self._names:
            return self._names.index(lower)
        known = lower.isascii() and lower.isdigit() and 0 < len(lower) < 6
        return int(lower) - 1 if known and 1 <= int(lower) <= len(self._names) else None
