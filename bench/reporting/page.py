"""The parts that docs/performance.rst includes: a file for each section, and its plot beside it."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

from reporting import beside, costs, speed
from reporting.cases import CASES
from reporting.parts import Part, spoken, times
from reporting.record import Record
from reporting.tables import table


class Section(NamedTuple):
    """The kinds of rows of which a section needs one, what makes its part, and kinds that it tells
    too where they are there."""

    kinds: tuple[str, ...]
    part: Callable[[Record], Part]
    also: tuple[str, ...] = ()


SECTIONS = {
    "peers": Section(("peers",), beside.peers),
    "particles": Section(("particles",), beside.particles),
    "renderers": Section(("renderers",), beside.renderers),
    "terrain": Section(("terrain",), beside.terrain),
    "pictures": Section(("refinements",), speed.pictures),
    "slow_disk": Section(("refinements",), speed.slow_disk),
    "rays": Section(("steady", "loaded"), speed.rays),
    "memory": Section(("budgets",), speed.memory),
    "size": Section(("billion",), speed.size),
    "growth": Section(("tracing",), speed.growth),
    "resolution": Section(("growth",), speed.resolution),
    "conversion": Section(("points",), costs.conversion),
    "ordering": Section(("ordering",), costs.ordering),
    "order": Section(("tree",), costs.order, ("random",)),
    "levels": Section(("levels",), costs.levels),
    "stadium": Section(("stadium",), costs.stadium),
    "checkpoints": Section(("checkpoints",), costs.checkpoints),
    "cluster": Section(("cluster",), costs.cluster),
}

#: The first line of each file, which names the report that it is of.
WRITTEN = ".. Written by bench/report.py from {}.\n\n"


def write_page(record: Record, folder: Path) -> None:
    """Write all parts into a folder, in place of what it has."""
    folder.mkdir(exist_ok=True)
    written = WRITTEN.format(record.path.name)
    parts = {name: _part(record, name, section) for name, section in SECTIONS.items()}
    for name, part in parts.items():
        picture = folder / f"{name}.png"
        picture.unlink(missing_ok=True)
        if part and part.draw:
            part.draw(picture)
        text = _text(name, part, picture.exists())
        (folder / f"{name}.rst").write_text(written + text)
    (folder / "summary.rst").write_text(written + _summary(record, folder))
    (folder / "machine.rst").write_text(written + _machine(record))


def _part(record: Record, name: str, section: Section) -> Part | None:
    if name == "slow_disk":
        there = bool(speed.disks(record))
    else:
        there = any(record.rows(kind) for kind in section.kinds)
    return section.part(record) if there else None


def _text(name: str, part: Part | None, drawn: bool) -> str:
    if part is None:
        return f"{_missing(name)}\n"
    image = f".. image:: performance/{name}.png\n   :alt: {_alt(name)}\n"
    return "\n\n".join(filter(None, [part.text, part.table, image if drawn else ""]))


def _alt(name: str) -> str:
    return f"Plot of the table above: {name.replace('_', ' ')}"


def _missing(name: str) -> str:
    kinds = SECTIONS[name].kinds + SECTIONS[name].also
    own = [case for case in CASES if case.kind in kinds]
    slow = [case for case in own if "--disk" in case.arguments]
    size = (slow if name == "slow_disk" else own)[0].size
    command = f"python bench/report.py --size {size} --only {' '.join(kinds)}"
    return f"Not measured in this report; ``{command}`` measures it."


def _machine(record: Record) -> str:
    """Version, day, machine and speeds of the hours."""
    found, machine = record.found, record.found["machine"]
    named = spoken(f"{name} {told}" for name, told in found["programs"].items())
    lines = [
        f"bfrt {found['version']} (commit {found['revision'] or 'unknown'}), {record.dates}, on "
        f"{machine['processor']} with {machine['cores']} cores and "
        f"{machine['memory'] / 2**30:.0f} GiB, {machine['system']}. Memory is capped by: "
        f"{machine['cap']}. Programs: {named}.",
    ]
    head = ["probe at, UTC", "disk, write MB/s", "disk, read MB/s", "loop, one process, s",
            "loop, one a core, s"]  # fmt: skip
    rows = []
    for probe in found["probes"]:
        disk = [probe.get(name) for name in ("disk_write", "disk_read")]
        speeds = ["–" if speed is None else f"{speed / 1e6:,.0f}" for speed in disk]
        loops = [f"{probe[n]:.3f}" if n in probe else "–" for n in ("loop", "loops")]
        rows.append([probe["time"][:16].replace("T", " "), *speeds, *loops])
    if rows:
        lines.append(table(head, rows))
    return "\n\n".join(lines) + "\n"


def _summary(record: Record, folder: Path) -> str:
    """At most ten lines, and the three plots."""
    lines = [line for said in SAID for line in [said(record)] if line]
    text = "\n".join(f"- {line}" for line in lines) or "Nothing has been measured yet."
    shown = [
        f".. image:: performance/{name}.png\n   :alt: {_alt(name)}\n"
        for name in ("peers", "growth", "pictures")
        if (folder / f"{name}.png").exists()
    ]
    return "\n\n".join([text, *shown])


def _of_peers(record: Record) -> str:
    rows = record.rows("peers")
    own = [row for row in rows if row["name"] == "bfrt" and not row["end"]]
    if not own:
        return ""
    most = max(own, key=lambda row: row["millions"])
    at = [row for row in rows if (row["millions"], row["cap"]) == (most["millions"], most["cap"])]
    others = [row for row in at if row["name"] != "bfrt"]
    told = [
        f"{beside.NAMES[row['name']]} is {row['end']}"
        if row["end"]
        else f"{beside.NAMES[row['name']]} takes {row['seconds']:.1f}"
        for row in others
    ]
    beside_it = f"; {spoken(told)}" if told else ""
    return (
        f"From a file of {most['millions']:g} million triangles to a million hits bfrt takes "
        f"{most['seconds']:.1f} seconds in {most['cap']}{beside_it}."
    )


def _of_kills(record: Record) -> str:
    rows = record.rows("peers") + record.rows("particles")
    if not rows:
        return ""
    own = [row for row in rows if row["name"] == "bfrt"]
    other = [row for row in rows if row["name"] != "bfrt"]
    killed = [sum(bool(row["end"]) for row in some) for some in (own, other)]
    return (
        f"Under caps of memory bfrt dies in {killed[0]} of {len(own)} runs, the programs that "
        f"hold their scenes in {killed[1]} of {len(other)}."
    )


def _of_particles(record: Record) -> str:
    rows = record.rows("particles")
    whole = [(a, b) for a in rows for b in rows
             if (a["name"], b["name"]) == ("bfrt", "ovito") and not (a["end"] or b["end"])
             and (a["millions"], a["cap"]) == (b["millions"], b["cap"])]  # fmt: skip
    if not whole:
        return ""
    a, b = max(whole, key=lambda pair: pair[0]["millions"])
    return (
        f"A picture of {a['millions']:g} million particles takes {a['seconds']:.1f} seconds from "
        f"the file: bfrt is {times(b['seconds'] / a['seconds'])} OVITO."
    )


def _of_a_part(name: str) -> Callable[[Record], str]:
    """The first sentence of a section."""

    def said(record: Record) -> str:
        part = _part(record, name, SECTIONS[name])
        return f"{part.text.split('. ')[0].rstrip('.')}." if part else ""

    return said


SAID = (_of_peers, _of_kills, _of_particles, *map(_of_a_part, (
    "size", "growth", "pictures", "memory", "rays", "conversion", "order",
)))  # fmt: skip
