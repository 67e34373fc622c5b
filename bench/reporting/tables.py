"""Rows as reStructuredText: simple tables, numbers with three digits or so, units in the heads."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

Line = Sequence[str]


def number(value: float | None) -> str:
    """Three digits, or all before the point; a dash for nothing."""
    if value is None:
        return "–"
    digits = 2 if abs(value) < 10 else 1 if abs(value) < 100 else 0
    return f"{value:,.{digits}f}"


def mib(value: float | None) -> str:
    """Bytes in MiB."""
    return "–" if value is None else f"{value / 2**20:,.0f}"


def gigabytes(value: float | None) -> str:
    """Bytes in GB."""
    return number(None if value is None else value / 1e9)


def millions(value: float | None) -> str:
    """A number in millions."""
    return number(None if value is None else value / 1e6)


def count(value: Any) -> str:
    """A whole number."""
    return "–" if value is None else f"{value:,}"


def table(head: Line, lines: Sequence[Line]) -> str:
    """A simple table: words to the left, numbers to the right; without columns of dashes alone."""
    columns = [[name, *(line[k] for line in lines)] for k, name in enumerate(head)]
    columns = [column for column in columns if set(column[1:]) != {"–"}]
    widths = [max(len(cell) for cell in column) for column in columns]
    right = [all(_is_number(cell) for cell in column[1:]) for column in columns]
    rule = "  ".join("=" * width for width in widths)

    def text(line: Line) -> str:
        cells = (
            cell.rjust(width) if to_the_right else cell.ljust(width)
            for cell, width, to_the_right in zip(line, widths, right, strict=True)
        )
        return "  ".join(cells).rstrip()

    first, *others = zip(*columns, strict=True)
    return "\n".join([rule, text(first), rule, *map(text, others), rule])


def _is_number(cell: str) -> bool:
    return cell == "–" or cell.replace(",", "").replace(".", "", 1).isdigit()
