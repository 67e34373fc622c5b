"""Rows as pictures: the same colors, axes and sizes in all."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from statistics import geometric_mean
from typing import Any

import matplotlib

matplotlib.use("agg")
from matplotlib import pyplot
from matplotlib.axes import Axes

from bfrt.memory import parse_memory
from reporting.kinds import Row, Rows
from reporting.parts import spaced

#: A color for each program and refinement, so that it is the same in all pictures.
COLORS = {
    "bfrt": "#c1272d", "open3d": "#2e6f9e", "mitsuba": "#3f8f3f", "trimesh": "#b8860b",
    "ovito": "#2e6f9e", "povray": "#2e6f9e", "tachyon": "#3f8f3f", "gdal_viewshed": "#2e6f9e",
    "bfrt sgb": "#c1272d", "bfrt tree": "#e0a030",
    "base": "#8c8c8c", "sg": "#e0a030", "sgb": "#c1272d", "tree": "#2e6f9e",
}  # fmt: skip

#: Points an inch, and inches of a picture.
DPI = 110
WIDE, HIGH = 7.2, 3.4


@contextmanager
def drawn(path: Path, panels: int = 1) -> Iterator[Any]:
    """Panels of a picture beside each other, that is saved at the end."""
    figure, axes = pyplot.subplots(
        1, panels, figsize=(WIDE, HIGH), sharey=True, squeeze=False, layout="constrained"
    )
    for axis in axes[0]:
        axis.grid(alpha=0.25, linewidth=0.6)
        axis.spines[["top", "right"]].set_visible(False)
    yield axes[0] if panels > 1 else axes[0][0]
    figure.savefig(path, dpi=DPI, metadata={"Software": None})
    pyplot.close(figure)


def against_size(rows: Rows, path: Path, what: str) -> None:
    """Seconds against millions, a panel for each cap; what was killed is a cross at the top."""
    caps = sorted({row["cap"] for row in rows}, key=parse_memory)
    top = 1.6 * max(row["seconds"] for row in rows)
    with drawn(path, len(caps)) as axes:
        for axis, cap in zip([axes] if len(caps) == 1 else axes, caps, strict=True):
            names = dict.fromkeys(row["name"] for row in rows)
            for k, name in enumerate(names):
                own = [row for row in rows if (row["cap"], row["name"]) == (cap, name)]
                _line_and_crosses(axis, own, name, top * 1.25**k)
            axis.set(xscale="log", yscale="log", xlabel=f"millions of {what}", title=spaced(cap))
            ticks = sorted({row["millions"] for row in rows})
            axis.set_xticks(ticks, [f"{tick:g}" for tick in ticks])
            axis.minorticks_off()
        first = [axes][0] if len(caps) == 1 else axes[0]
        first.set_ylabel("seconds, file to answer (× killed)")
        first.legend(fontsize="small")


def _line_and_crosses(axis: Axes, rows: Rows, name: str, top: float) -> None:
    alive = sorted((row["millions"], row["seconds"]) for row in rows if not row["end"])
    dead = sorted(row["millions"] for row in rows if row["end"])
    color = COLORS[name]
    width = 2.2 if name == "bfrt" else 1.2
    xs, ys = [x for x, _ in alive], [y for _, y in alive]
    axis.plot(xs, ys, "o-", color=color, label=name, linewidth=width, markersize=4)
    axis.plot(dead, [top] * len(dead), "x", color=color, markersize=7)


def growth(rows: Rows, path: Path, power: float | None) -> None:
    """Seconds of tracing against objects, both logarithmic, a line for each scene."""
    with drawn(path) as axis:
        for k, scene in enumerate(dict.fromkeys(row["scene"] for row in rows)):
            own = sorted((row["objects"], row["seconds"]) for row in rows if row["scene"] == scene)
            xs, ys = [x for x, _ in own], [y for _, y in own]
            axis.loglog(xs, ys, "o-", color="#c1272d" if k == 0 else f"C{k}", label=scene)
        if power is not None:
            ends = [pick(row["objects"] for row in rows) for pick in (min, max)]
            x, y = (geometric_mean(row[name] for row in rows) for name in ("objects", "seconds"))
            said = f"objects to the power of {power:.2f}"
            line = [y * (end / x) ** power for end in ends]
            axis.plot(ends, line, "--", color="#8c8c8c", label=said)
        axis.set(xlabel="objects", ylabel="seconds of tracing, 256 MiB")
        axis.legend(fontsize="small")


def gains(rows: Rows, path: Path) -> None:
    """What each refinement gains over base: bars for each scene; black marks are the paper's."""
    names = ("sg", "sgb", "tree")
    with drawn(path) as axis:
        for k, name in enumerate(names):
            at = [n + 0.27 * (k - 1) for n in range(len(rows))]
            axis.bar(at, [row[name] for row in rows], 0.25, color=COLORS[name], label=name)
            theirs = [(x, row[f"paper {name}"]) for x, row in zip(at, rows, strict=True)
                      if row.get(f"paper {name}")]  # fmt: skip
            axis.plot([x for x, _ in theirs], [y for _, y in theirs], "k_", markersize=11,
                      label="the paper's" if name == "sgb" else None)  # fmt: skip
        axis.axhline(1, color="black", linewidth=0.7)
        labels = [f"{row['scene']} {row['size']}" for row in rows]
        axis.set_xticks(range(len(rows)), labels, fontsize="small")
        axis.set_ylabel("times as fast as base")
        axis.legend(fontsize="small", ncols=2)


def bars(rows: Rows, path: Path, groups: Sequence[str], column: str, unit: str) -> None:
    """A bar for each row: grouped by a first column, colored by a second."""
    place, series = groups
    places = list(dict.fromkeys(str(row[place]) for row in rows))
    names = list(dict.fromkeys(str(row[series]) for row in rows))
    width = 0.8 / len(names)
    with drawn(path) as axis:
        for k, name in enumerate(names):
            own = [row for row in rows if str(row[series]) == name]
            at = [places.index(str(row[place])) + width * (k - (len(names) - 1) / 2) for row in own]
            color = COLORS.get(name, f"C{k}")
            axis.bar(at, [row[column] for row in own], width * 0.92, color=color, label=name)
        axis.set_xticks(range(len(places)), places, fontsize="small")
        axis.set_ylabel(unit)
        if len(names) > 1:
            axis.legend(fontsize="small")


def lines(rows: Rows, path: Path, axes: Sequence[str], series: str, labels: Sequence[str]) -> None:
    """A line for each value of a column; both axes are logarithmic."""
    x, y = axes
    with drawn(path) as axis:
        for name in dict.fromkeys(str(row[series]) for row in rows):
            own: list[Row] = sorted((row for row in rows if str(row[series]) == name),
                                    key=lambda row: row[x])  # fmt: skip
            axis.loglog([row[x] for row in own], [row[y] for row in own], "o-", label=name)
        axis.set(xlabel=labels[0], ylabel=labels[1])
        axis.legend(fontsize="small", ncols=2)
