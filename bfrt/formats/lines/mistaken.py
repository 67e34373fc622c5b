"""What begins as points of text do not: grids of heights, and numbers with a decimal comma."""

from __future__ import annotations

import re

from bfrt.errors import SceneError
from bfrt.formats.gzipped import GRID
from bfrt.formats.source import quoted

#: A number with a comma before its decimals.
DECIMAL_COMMA = re.compile(rb"[+-]?\d+,\d+(?:[eE][+-]?\d+)?")

#: A number, or one with a decimal comma, between blanks.
NUMBER = re.compile(rb"[+-]?\d*[.,]?\d+(?:[eE][+-]?\d+)?")

#: Columns that points have at the least.
LEAST_COLUMNS = 3

#: How a grid of heights begins, what it is called, and what makes it one that is read.
GRIDS = (
    (GRID, "an Esri grid", "plain, not packed and without a byte order mark, .asc is read as such"),
    (re.compile(rb"DSAA\b"), "a Surfer grid", "gdal_translate makes a GeoTIFF of it"),
    (
        re.compile(rb"(?:north|south|east|west|rows|cols):"),
        "a GRASS grid",
        "gdal_translate makes a GeoTIFF of it",
    ),
)


def refuse_grid(place: str, line: bytes) -> None:
    """Refuse a line, at a place that errors tell, that begins a grid.

    Raises
    ------
    SceneError
    """
    for begin, kind, instead in GRIDS:
        if begin.match(line):
            raise SceneError(
                f"{place}: found {quoted(line)}, with which {kind} begins, expected points: "
                f"{instead}"
            )


def refuse_decimal_commas(place: str, line: bytes, fields: list[bytes]) -> None:
    """Refuse a line that has numbers with a decimal comma: among fields, or parted by blanks.

    Raises
    ------
    SceneError
    """
    blanks = line.split()
    parted = len(blanks) >= LEAST_COLUMNS and all(map(NUMBER.fullmatch, blanks))
    for field in (*(blanks if parted else ()), *fields):
        if DECIMAL_COMMA.fullmatch(field):
            raise SceneError(
                f"{place}: found {quoted(field)}, expected a number with a decimal point"
                f"{in_place_of_comma(field)}"
            )


def in_place_of_comma(field: bytes) -> str:
    """Return how a number is written that has a decimal comma; nothing for any other text."""
    comma = DECIMAL_COMMA.fullmatch(field) is not None
    return f", as {field.replace(b',', b'.').decode()}" if comma else ""
