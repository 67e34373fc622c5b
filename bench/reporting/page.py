"""The parts that docs/performance.rst includes: a file for each section, and its plot beside it."""

from __future__ import annotations

from pathlib import Path

from reporting.parts import Part, spoken
from reporting.record import Record
from reporting.sections import SECTIONS, command_of, part_of
from reporting.summary import lines_of
from reporting.tables import table

#: The plots of the summary.
PLOTS = ("peers", "growth", "pictures")

#: The first line of each file, which names the report that it is of.
WRITTEN = ".. Written by bench/report.py from {}.\n\n"


def write_page(record: Record, folder: Path) -> None:
    """Write all parts into a folder, in place of what it has."""
    folder.mkdir(exist_ok=True)
    written = WRITTEN.format(record.path.name)
    parts = {name: part_of(record, name) for name in SECTIONS}
    for name, part in parts.items():
        picture = folder / f"{name}.png"
        picture.unlink(missing_ok=True)
        if part and part.draw:
            part.draw(picture)
        text = _text(name, part, picture.exists())
        (folder / f"{name}.rst").write_text(written + text)
    (folder / "summary.rst").write_text(written + _summary(record, folder))
    (folder / "machine.rst").write_text(written + _machine(record))


def _text(name: str, part: Part | None, drawn: bool) -> str:
    if part is None:
        return f"Not measured in this report; ``{command_of(name)}`` measures it.\n"
    return "\n\n".join(filter(None, [part.text, part.table, _plot(name) if drawn else ""]))


def _plot(name: str) -> str:
    said = SECTIONS[name].plot
    return f".. figure:: performance/{name}.png\n   :alt: {said}\n\n   {said}\n"


def _machine(record: Record) -> str:
    """Version, day, machine and speeds of the hours."""
    found, machine = record.found, record.found["machine"]
    named = spoken(f"{name} {told}" for name, told in found["programs"].items())
    lines = [
        f"bfrt {found['version']} (commit {found['revision'] or 'unknown'}), {record.dates}, on "
        f"{machine['processor']} with {machine['cores']} cores and "
        f"{machine['memory'] / 2**30:.0f} GiB, {machine['system']}. Memory is capped by: "
        f"{machine['cap']}. Programs: {named}.",
        *([found["note"]] if "note" in found else []),
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
    """The summary's lines, and the three plots."""
    text = "\n".join(f"- {line}" for line in lines_of(record)) or "Nothing has been measured yet."
    shown = [_plot(name) for name in PLOTS if (folder / f"{name}.png").exists()]
    return "\n\n".join([text, *shown])
