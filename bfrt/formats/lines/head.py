"""The first lines of points of text: comments, a count, names of columns, and what parts them."""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import NamedTuple

from bfrt.errors import SceneError, SettingError
from bfrt.formats.columns import POSITION
from bfrt.formats.lines._lines import MOST_COLUMNS
from bfrt.formats.lines.mistaken import refuse_decimal_commas, refuse_grid
from bfrt.formats.reading import COLORS
from bfrt.formats.source import Source, quoted

#: Bytes in which the first rows have to be.
LOOK = 1 << 16

#: What parts columns, where it is not blanks; of several in a line the first counts.
SEPARATORS = (b"\t", b";", b",", b"|")
BLANK = b" "

#: What comments of whole lines begin with.
COMMENTS = (b"#", b"//")

#: Names of columns that have none, by their number; those behind go by their numbers, from 1.
USUAL = {
    4: (*POSITION, "intensity"),
    6: (*POSITION, *COLORS),
    7: (*POSITION, "intensity", *COLORS),
}

#: What begins a comment behind what is in a line, and the rest.
COMMENT_BEHIND = re.compile(rb"\s#.*", re.DOTALL)

#: Digits of a count, at the most: of more it is none of rows.
COUNT_DIGITS = 18

#: What stands for a column that is not wanted, in the names that a setting gives.
NO_NAME = "-"

#: A line and its end, of which the last may have none.
LINE = re.compile(rb"[^\r\n]*(?:\r\n|\r|\n|\Z)")


def ends_in(text: bytes, begin: int, end: int) -> int:
    """Count the ends of lines in a part of a text, LF, CR LF or CR, which has a byte before."""
    each = text.count(b"\n", begin, end) + text.count(b"\r", begin, end)
    return each - text.count(b"\r\n", begin - 1, end)


class Place(NamedTuple):
    """Marks a place in a text: a byte, and its line."""

    at: int
    line: int


class Line(NamedTuple):
    """Holds a line without its end, its number from 1, and where it begins."""

    text: bytes
    number: int
    at: int


class Head(NamedTuple):
    """Says how the rows of a file are.

    Attributes
    ----------
    names : tuple of str
        Of the columns, in lower case.
    separator : bytes
        What parts columns, a blank for blanks.
    start : int
        The byte of the text at which rows begin.
    line : int
        The line there.
    rows : int, optional
        Rows that a line before them promises.
    """

    names: tuple[str, ...]
    separator: bytes
    start: int
    line: int
    rows: int | None


def read_head(source: Source, column_names: str | None) -> Head:
    """Find out how a file's rows are.

    Parameters
    ----------
    source : Source
    column_names : str, optional
        Names for the columns, in place of those that the file has.

    Raises
    ------
    SceneError
        If no row is found, or it is no text.
    SettingError
        If there are not as many columns as `column_names` has.
    """
    comment: Line | None = None
    rows: int | None = None
    title: Line | None = None
    for line in lines_of(source.head(LOOK), source):
        text, place = line.text.strip(), f"{source.name}: line {line.number}"
        if title is None:
            refuse_grid(place, text)
        number = COMMENT_BEHIND.sub(b"", text).rstrip()
        if text.startswith(COMMENTS):
            comment = line
        elif rows is None and title is None and number.isdigit() and len(number) <= COUNT_DIGITS:
            rows = int(number)
        elif text:
            fields = fields_of(row_of(text), separator_of(row_of(text)))
            named = title is None and is_title(fields)
            refuse_decimal_commas(place, text, fields if named else [])
            if not named:
                return head_of(source, line, title or comment, rows, column_names)
            title = line
    if rows == 0 or (title is not None and has_positions(title)):  # a count of none, or names alone
        return Head(POSITION, BLANK, source.most_text, 1, rows)
    raise SceneError(f"{source.name}: found no line of numbers, expected points, one a line")


def lines_of(text: bytes, source: Source) -> Iterator[Line]:
    """Yield the first lines of a text.

    Raises
    ------
    SceneError
        If a line has a NUL: it is no text.
    """
    for number, found in enumerate(LINE.finditer(text), 1):
        line = Line(found[0].rstrip(b"\r\n"), number, found.start())
        if b"\0" in line.text:
            raise SceneError(
                f"{source.name}: line {number}: found {quoted(line.text)}, expected text"
            )
        yield line


def is_title(fields: list[bytes]) -> bool:
    """Tell whether a line has names: fields of which none is a number, and more than one."""
    return len(fields) > 1 and not any(is_number(field) for field in fields if field)


def has_positions(title: Line) -> bool:
    """Tell whether a line of names has those of positions."""
    row = row_of(title.text.strip())
    return {name.encode() for name in POSITION} <= {
        field.lower() for field in fields_of(row, separator_of(row))
    }


def is_number(field: bytes) -> bool:
    """Tell whether a field is a number, of those that are not finite too."""
    try:
        float(field.lower().replace(b"1.#", b""))
    except ValueError:
        return False
    return True


def row_of(line: bytes) -> bytes:
    """Return a row without the comment behind it.

    In a row that a separator parts, a ``#`` may be in a text, as of ``Well #5``.
    """
    row = COMMENT_BEHIND.sub(b"", line)
    return row if sum(map(is_number, row.split())) >= len(POSITION) else line


def separator_of(line: bytes) -> bytes:
    """Return what parts the columns of a line."""
    for separator in SEPARATORS:
        if separator in line:
            if separator == b"\t" and any(len(f.split()) != 1 for f in line.split(b"\t")):
                continue  # there are blanks that are no tabs, or several tabs in a row
            return separator
    return BLANK


def fields_of(line: bytes, separator: bytes) -> list[bytes]:
    """Return the fields of a line, without quotes and the blanks around."""
    if separator == BLANK:
        return [field.strip(b'"') for field in line.split()]
    fields: list[bytes] = []
    for piece in line.split(separator):
        if fields and fields[-1].count(b'"') % 2:  # a separator in quotes
            fields[-1] += separator + piece
        else:
            fields.append(piece)
    return [field.strip().strip(b'"').strip() for field in fields]


def head_of(
    source: Source, first: Line, title: Line | None, rows: int | None, asked: str | None
) -> Head:
    """Put together what is known from a file's first row, and from the names before it."""
    row = row_of(first.text)
    separator = separator_of(row)
    count = len(fields_of(row, separator))
    if count > MOST_COLUMNS:
        raise SceneError(
            f"{source.name}: line {first.number}: found {count} columns, expected "
            f"{MOST_COLUMNS} or fewer"
        )
    names = None if title is None else names_in(title, separator, count)
    if asked is not None:
        names = names_asked(source, asked, count)
    elif names is None and title is not None and not title.text.strip().startswith(COMMENTS):
        raise SceneError(
            f"{source.name}: line {title.number}: found {quoted(title.text)} before a row of "
            f"{count} columns, expected a name for each"
        )
    return Head(names or usual_names(source, count), separator, first.at, first.number, rows)


def names_in(title: Line, separator: bytes, count: int) -> tuple[str, ...] | None:
    """Return the names in a line, in lower case; None if they are not those of the columns.

    Those of a comment are, if there are as many, and x, y and z are among them. A column whose
    name is empty goes by its number.
    """
    text = title.text.strip()
    comment = text.startswith(COMMENTS)
    text = text.lstrip(b"#/") if comment else text
    for line in (COMMENT_BEHIND.sub(b"", text), text):  # a name may have a # behind a blank
        for each in (separator, separator_of(line), BLANK):
            fields = [f.decode("utf-8", "replace").lower() for f in fields_of(line, each)]
            names = tuple(field or str(k) for k, field in enumerate(fields, 1))
            if len(names) == count and (not comment or set(POSITION) <= set(names)):
                return names
    return None


def names_asked(source: Source, asked: str, count: int) -> tuple[str, ...]:
    """Return the names that a setting gives columns, in lower case."""
    names = tuple(asked.replace(",", " ").lower().split())
    if len(names) != count:
        raise SettingError(
            f"{source.name}: found {count} columns and {len(names)} names in column_names, "
            f"expected a name for each, {NO_NAME} for one that is not wanted"
        )
    repeated = [name for name in names if name != NO_NAME and names.count(name) > 1]
    if repeated:
        raise SettingError(
            f"{source.name}: found {repeated[0]} more than once in column_names, expected names "
            "that differ"
        )
    return names


def usual_names(source: Source, count: int) -> tuple[str, ...]:
    """Return the names of columns that have none.

    Raises
    ------
    SceneError
        If there are fewer than three.
    """
    if count < len(POSITION):
        raise SceneError(
            f"{source.name}: found {count} columns, expected x, y and z, and what belongs to them"
        )
    usual = USUAL.get(count, POSITION)
    return (*usual, *(str(number) for number in range(len(usual) + 1, count + 1)))
