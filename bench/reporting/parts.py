"""What a section of the page is made of, and how rows are picked and compared for it."""

from __future__ import annotations

import csv
import math
import re
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import NamedTuple

from reporting.kinds import Row, Rows

#: The paper's table 1.
PAPER = Path(__file__).resolve().parents[1] / "paper-table1.csv"


class Part(NamedTuple):
    """A section's answer: sentences, a table, and what draws its plot at a path."""

    text: str
    table: str
    draw: Callable[[Path], None] | None = None


def one(rows: Rows, **wanted: object) -> Row | None:
    """The last row whose columns are as wanted."""
    found = [row for row in rows if all(row.get(name) == v for name, v in wanted.items())]
    return found[-1] if found else None


def by(rows: Rows, *names: str) -> dict[tuple[object, ...], Rows]:
    """Rows in groups that have the same columns, in the order of the first of each."""
    groups: dict[tuple[object, ...], Rows] = {}
    for row in rows:
        groups.setdefault(tuple(row[name] for name in names), []).append(row)
    return groups


def power(rows: Rows) -> float | None:
    """What seconds grow like: the exponent of objects, by least squares of logarithms."""
    if len(rows) < 2:
        return None
    xs = [math.log(row["objects"]) for row in rows]
    ys = [math.log(row["seconds"]) for row in rows]
    x, y = sum(xs) / len(xs), sum(ys) / len(ys)
    return sum((a - x) * (b - y) for a, b in zip(xs, ys, strict=True)) / sum(
        (a - x) ** 2 for a in xs
    )


def times(ratio: float) -> str:
    """A ratio in words: 2.3 times as fast, or 0.84 of the speed."""
    return f"{ratio:.1f} times as fast as" if ratio >= 1 else f"{ratio:.2f} of the speed of"


def spaced(cap: str) -> str:
    """A cap as text has it: 256 MiB for 256MiB."""
    return re.sub(r"(\d)([A-Z])", r"\1 \2", cap)


def spoken(words: Iterable[str]) -> str:
    """Words with commas and an and."""
    said = list(words)
    return f"{', '.join(said[:-1])} and {said[-1]}" if len(said) > 1 else "".join(said)


def paper_gains() -> dict[tuple[str, int], dict[str, float]]:
    """The paper's gains, by scene and size."""
    with PAPER.open() as file:
        rows = csv.DictReader(line for line in file if not line.startswith("#"))
        return {
            (row["scene"], int(row["size"])): {name: float(row[name]) for name in ("sg", "sgb")}
            for row in rows
        }
