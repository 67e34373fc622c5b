"""The header of a PCD file: its fields, rows and layout."""

from __future__ import annotations

import re
from typing import Any, NamedTuple

import numpy as np

from bfrt.errors import SceneError
from bfrt.formats.lines._lines import MOST_COLUMNS
from bfrt.formats.lines.head import COUNT_DIGITS, lines_of
from bfrt.formats.source import Source, quoted

#: Bytes of a header, at the most; and of a row.
HEADER_BYTES = 1 << 17
ROW_BYTES = 1 << 16

LAYOUTS = ("ascii", "binary", "binary_compressed")

#: NumPy's codes of types, and the bytes that they have.
TYPES = {"I": ("i", (1, 2, 4, 8)), "U": ("u", (1, 2, 4, 8)), "F": ("f", (4, 8))}

#: What a field has where the file does not say, as of before version 0.6.
USUAL_SIZE, USUAL_TYPE, USUAL_COUNT = "4", "F", "1"

#: Words that begin a line, and those that a file may do without.
NEEDED = ("FIELDS", "DATA")
OPTIONAL = ("VERSION", "SIZE", "TYPE", "COUNT", "WIDTH", "HEIGHT", "VIEWPOINT", "POINTS")

#: The last line, behind which bytes may be anything.
LAST = re.compile(rb"(?:\A|[\r\n])[ \t]*DATA[ \t][^\r\n]*(?:\r\n|\r|\n|\Z)")


class Field(NamedTuple):
    """Describes a field of a row: `numbers` of a type, from a byte of the row on."""

    name: str
    dtype: np.dtype[Any]
    numbers: int
    offset: int


class Header(NamedTuple):
    """Says what a file contains.

    Attributes
    ----------
    fields : tuple of Field
    rows : int
    layout : {"ascii", "binary", "binary_compressed"}
    start : int
        The byte of the text at which rows begin.
    line : int
        The line there.
    """

    fields: tuple[Field, ...]
    rows: int
    layout: str
    start: int
    line: int

    @property
    def row_bytes(self) -> int:
        """Return the bytes of a row."""
        last = self.fields[-1]
        return last.offset + last.numbers * last.dtype.itemsize


def read_header(source: Source) -> Header:
    """Read the header, and check each of its lines.

    Raises
    ------
    SceneError
        If it is none of PCD.
    """
    found: dict[str, tuple[list[str], str]] = {}
    text = source.head(HEADER_BYTES)
    last = LAST.search(text)
    for line in lines_of(text[: last.end()] if last else text, source):
        words = line.text.decode("ascii", "backslashreplace").split()
        where = f"{source.name}: line {line.number}: found {quoted(line.text)}, expected"
        if not words or words[0].startswith("#"):
            continue
        key = "FIELDS" if words[0] == "COLUMNS" else words[0]
        if key not in (*NEEDED, *OPTIONAL):
            raise SceneError(f"{where} a line of a PCD header: {', '.join((*NEEDED, *OPTIONAL))}")
        if key in found:
            raise SceneError(f"{where} {key} once")
        found[key] = (words[1:], where)
        if key == "DATA" and last:
            return header_of(source, found, last.end(), line.number + 1)
    raise SceneError(f"{source.name}: found no line DATA, expected a PCD header that it ends")


def header_of(
    source: Source, found: dict[str, tuple[list[str], str]], start: int, line: int
) -> Header:
    """Put together what the lines say."""
    for key in NEEDED:
        if key not in found:
            raise SceneError(f"{source.name}: found a PCD header without {key}, expected it")
    words, where = found["DATA"]
    if len(words) != 1 or words[0] not in LAYOUTS:
        raise SceneError(f"{where} DATA and one of {', '.join(LAYOUTS)}")
    if words[0] != "ascii" and not source.is_utf8:
        raise SceneError(f"{where} DATA ascii, as the file is UTF-16")
    fields = fields_of(source, found)
    header = Header(fields, rows_of(source, found), words[0], start, line)
    if header.row_bytes > ROW_BYTES:
        raise SceneError(
            f"{source.name}: found rows of {header.row_bytes} bytes, expected {ROW_BYTES} or fewer"
        )
    return header


def fields_of(source: Source, found: dict[str, tuple[list[str], str]]) -> tuple[Field, ...]:
    """Return the fields, of which names, sizes, types and counts are in lines of their own."""
    names = found["FIELDS"][0]
    usual = {"SIZE": USUAL_SIZE, "TYPE": USUAL_TYPE, "COUNT": USUAL_COUNT}
    sizes, kinds, counts = (
        found[key][0] if key in found else [value] * len(names) for key, value in usual.items()
    )
    if not names or not len(names) == len(sizes) == len(kinds) == len(counts):
        raise SceneError(
            f"{source.name}: found {len(names)} fields, {len(sizes)} sizes, {len(kinds)} types and "
            f"{len(counts)} counts, expected one or more, and as many of each"
        )
    fields: list[Field] = []
    offset = 0
    for name, size, kind, count in zip(names, sizes, kinds, counts, strict=True):
        code, known = TYPES.get(kind, ("", ()))
        if number_of(size) not in known or not 0 < (number_of(count) or 0) <= MOST_COLUMNS:
            raise SceneError(
                f"{source.name}: found {quoted(name.encode())} of type {quoted(kind.encode())}, "
                f"size {quoted(size.encode())} and count {quoted(count.encode())}, expected I or U "
                f"of 1, 2, 4 or 8 bytes or F of 4 or 8, and a count of 1 to {MOST_COLUMNS}"
            )
        fields.append(Field(name, np.dtype(f"<{code}{int(size)}"), int(count), offset))
        offset += int(size) * int(count)
    return tuple(fields)


def rows_of(source: Source, found: dict[str, tuple[list[str], str]]) -> int:
    """Return the number of rows: POINTS, which is WIDTH times HEIGHT."""
    numbers: dict[str, int] = {}
    for key in ("WIDTH", "HEIGHT", "POINTS"):
        if key in found:
            words, where = found[key]
            number = number_of(words[0]) if len(words) == 1 else None
            if number is None:
                raise SceneError(
                    f"{where} {key} and a whole number of {COUNT_DIGITS} digits or fewer"
                )
            numbers[key] = number
    area = numbers.get("WIDTH", 1) * numbers.get("HEIGHT", 1)
    rows = numbers.get("POINTS", area if "WIDTH" in numbers else None)
    if rows is None or ("WIDTH" in numbers and area != rows) or rows >= 10**COUNT_DIGITS:
        raise SceneError(
            f"{source.name}: found {', '.join(f'{k} {n}' for k, n in numbers.items()) or 'none'}, "
            "expected POINTS, which are WIDTH times HEIGHT"
        )
    return rows


def number_of(word: str) -> int | None:
    """Return a whole number, 0 or more, or None for what is none."""
    fits = word.isascii() and word.isdigit() and len(word) <= COUNT_DIGITS
    return int(word) if fits else None
