"""The sections of the page: which rows each tells of, what makes its part, what its plot shows."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

from reporting import beside, costs, speed
from reporting.cases import CASES
from reporting.parts import Part
from reporting.record import Record


class Section(NamedTuple):
    """Describes a section.

    Attributes
    ----------
    kinds : tuple of str
        The kinds of rows, of which it needs one.
    part : callable
        Makes its part of a report.
    plot : str
        What its plot shows.
    also : tuple of str
        Kinds that it tells too where they are there.
    """

    kinds: tuple[str, ...]
    part: Callable[[Record], Part]
    plot: str
    also: tuple[str, ...] = ()


SECTIONS = {
    "peers": Section(
        ("peers",),
        beside.peers,
        "Seconds from the files to the hits against millions of triangles, a panel for each cap. "
        "A cross at the top is a run that died of its cap.",
    ),
    "particles": Section(
        ("particles",),
        beside.particles,
        "Seconds from the file to the picture against millions of particles, a panel for each "
        "cap. A cross at the top is a run that died of its cap.",
    ),
    "renderers": Section(("renderers",), beside.renderers, "Seconds of a whole command."),
    "terrain": Section(("terrain",), beside.terrain, "Seconds of a whole command."),
    "pictures": Section(
        ("refinements",),
        speed.pictures,
        "What each refinement gains over base, at the largest size of each scene. Black marks are "
        "the paper's gains.",
    ),
    "slow_disk": Section(
        ("refinements",),
        speed.slow_disk,
        "What each refinement gains over base on a slow disk. Black marks are the paper's gains.",
    ),
    "rays": Section(("steady", "loaded"), speed.rays, "Millions of rays a second."),
    "memory": Section(("budgets",), speed.memory, "Seconds of a render against its budget."),
    "size": Section(("billion",), speed.size, "Seconds of each step, in 256 MiB."),
    "growth": Section(
        ("tracing",),
        speed.growth,
        "Seconds of tracing against objects, in 256 MiB; both axes are logarithmic.",
    ),
    "resolution": Section(
        ("growth",),
        speed.resolution,
        "Seconds of whole renders against objects, of grids as fine as the rule wants.",
    ),
    "conversion": Section(("points",), costs.conversion, "Millions of points a second."),
    "ordering": Section(("ordering",), costs.ordering, "Millions of objects a second."),
    "order": Section(("tree",), costs.order, "Seconds of tracing, by both.", ("random",)),
    "levels": Section(("levels",), costs.levels, "Seconds without preprocess."),
    "stadium": Section(("stadium",), costs.stadium, "Seconds of a render."),
    "checkpoints": Section(("checkpoints",), costs.checkpoints, "Seconds of a render."),
    "cluster": Section(("cluster",), costs.cluster, "Seconds of a picture, and of rays."),
}


def part_of(record: Record, name: str) -> Part | None:
    """Make a section's part of a report; None where nothing of it was measured."""
    section = SECTIONS[name]
    rows = [row for kind in section.kinds for row in record.rows(kind)]
    if name in ("pictures", "slow_disk"):
        rows = [row for row in rows if bool(row["disk"]) == (name == "slow_disk")]
    return section.part(record) if rows else None


def command_of(name: str) -> str:
    """The command that measures what a section tells, at the smallest size that does."""
    kinds = SECTIONS[name].kinds + SECTIONS[name].also
    own = [case for case in CASES if case.kind in kinds]
    slow = [case for case in own if "--disk" in case.arguments]
    size = (slow if name == "slow_disk" else own)[0].size
    return f"python bench/report.py --size {size} --only {' '.join(kinds)}"
