"""How numbers went from version to version: those of several reports, side by side."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

from reporting.kinds import KINDS, key_of
from reporting.record import Record
from reporting.tables import number


class Point(NamedTuple):
    """A number of a report: the day it was measured, and which version's it is."""

    day: str
    version: str
    value: float

    @property
    def label(self) -> str:
        return f"{self.version}\n{self.day}"


Courses = dict[tuple[str, str], list[Point]]


def version_of(record: Record) -> str:
    """A version's name: the commit where there is one."""
    found = record.found
    return str(found["revision"] or found["version"])


def courses(records: Sequence[Record]) -> Courses:
    """The course of each number that more than one report has, from the oldest on."""
    found: Courses = {}
    for record in records:
        for case in record.cases.values():
            kind = case["kind"]
            for row in case["rows"]:
                value = row.get(KINDS[kind].number)
                if value is None or row.get("end"):
                    continue
                named = " ".join(str(part) for part in key_of(kind, row) if part is not None)
                point = Point(case["time"][:10], version_of(record), value)
                found.setdefault((kind, named), []).append(point)
    kept = {key: sorted(points) for key, points in found.items()}
    return {key: points for key, points in kept.items() if len({p[:2] for p in points}) > 1}


def told(found: Courses) -> list[str]:
    """A line for each course: its numbers, and the last over the first."""
    lines = []
    for (kind, named), points in found.items():
        ratio = points[-1].value / points[0].value
        values = "  ".join(
            f"{point.version} {point.day} {_shown(kind, point.value)}" for point in points
        )
        lines.append(f"{ratio:6.2f}  {kind:12} {named:36} {values}")
    return lines


def _shown(kind: str, value: float) -> str:
    unit = KINDS[kind].unit
    return f"{number(value / 1e6)} M{unit}" if unit == "rays/s" else f"{number(value)} {unit}"


def draw(found: Courses, path: Path) -> None:
    """A panel for each kind: each number over the first of its course."""
    from matplotlib import pyplot

    kinds = list(dict.fromkeys(kind for kind, _ in found))
    labels = [p.label for p in sorted({p._replace(value=0.0) for ps in found.values() for p in ps})]
    figure, axes = pyplot.subplots(
        len(kinds), 1, figsize=(8, 2.6 * len(kinds)), squeeze=False, layout="constrained"
    )
    for (axis,), kind in zip(axes, kinds, strict=True):
        for (other, named), points in found.items():
            if other == kind:
                xs = [labels.index(point.label) for point in points]
                ys = [point.value / points[0].value for point in points]
                axis.plot(xs, ys, "o-", linewidth=0.9, markersize=3, label=named)
        axis.set_xticks(range(len(labels)), labels, fontsize="small")
        axis.set(yscale="log", title=f"{kind}: {KINDS[kind].number} over the first")
        axis.axhline(1, color="grey", linewidth=0.6)
        axis.legend(fontsize="xx-small", ncols=4)
    figure.savefig(path, dpi=110, metadata={"Software": None})
    pyplot.close(figure)
