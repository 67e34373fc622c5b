"""Against what: parts about bfrt beside other programs."""

from __future__ import annotations

from functools import partial

from bfrt.memory import parse_memory
from reporting import plots
from reporting.kinds import Row, Rows
from reporting.parts import Part, by, one, spaced, spoken, times
from reporting.record import Record
from reporting.tables import count, mib, number, table

#: Names as programs write them.
NAMES = {"bfrt": "bfrt", "open3d": "Open3D", "mitsuba": "Mitsuba 3", "trimesh": "trimesh",
         "ovito": "OVITO", "povray": "POV-Ray", "tachyon": "Tachyon",
         "gdal_viewshed": "gdal_viewshed"}  # fmt: skip


#: The end of a run that took more memory than its cap.
KILLED = "killed"


def peers(record: Record) -> Part:
    """A mesh's file to a million rays' hits."""
    return _under_caps(record.rows("peers"), "triangles")


def particles(record: Record) -> Part:
    """A file of positions to a picture."""
    return _under_caps(record.rows("particles"), "particles")


def _under_caps(rows: Rows, what: str) -> Part:
    names = list(dict.fromkeys(row["name"] for row in rows))
    rows = sorted(rows, key=lambda row: (row["millions"], parse_memory(row["cap"])))
    lines = []
    for (millions, cap), own in by(rows, "millions", "cap").items():
        cells = [_cell(one(own, name=name)) for name in names]
        lines.append([f"{millions:g}", spaced(str(cap)), *(c for pair in cells for c in pair)])
    head = [f"M {what}", "cap"]
    for name in names:
        head += [f"{NAMES[name]}, s", "MiB"]
    timed = [row for row in rows if row["end"] in ("", KILLED)]
    shown = [{**row, "seconds": row.get("seconds") or 0.1} for row in timed]
    draw = partial(plots.against_size, shown, what=what)
    return Part(f"{_deaths(rows, names)} {where_all_live(rows)}".strip(), table(head, lines), draw)


def _cell(row: Row | None) -> tuple[str, str]:
    if row is None:
        return "–", "–"
    return (row["end"], "–") if row["end"] else (number(row["seconds"]), mib(row.get("peak")))


def _deaths(rows: Rows, names: list[str]) -> str:
    """How many runs of each program died of their cap."""
    said, failed = [], []
    for name in names:
        own = [row for row in rows if row["name"] == name]
        said.append(f"{NAMES[name]} {sum(row['end'] == KILLED for row in own)} of {len(own)}")
        if faults := {row["end"] for row in own} - {"", KILLED}:
            failed.append(f"{NAMES[name]} does not work on this machine ({spoken(faults)}).")
    return " ".join([f"Runs that died of their cap: {spoken(said)}.", *failed])


def where_all_live(rows: Rows) -> str:
    """How fast bfrt is at the largest size and cap where there is memory for all; else nothing."""
    rows = [row for row in rows if row["end"] in ("", KILLED)]
    names = {row["name"] for row in rows}
    rows.sort(key=lambda row: (row["millions"], parse_memory(row["cap"])))
    whole = [
        group
        for group in by(rows, "millions", "cap").values()
        if len(group) == len(names) > 1 and not any(row["end"] for row in group)
    ]
    own = one(whole[-1], name="bfrt") if whole else None
    if own is None:
        return ""
    ratios = spoken(
        f"{times(row['seconds'] / own['seconds'])} {NAMES[row['name']]}"
        for row in whole[-1]
        if row is not own
    )
    return f"At {own['millions']:g} million in {spaced(own['cap'])} bfrt is {ratios}."


def renderers(record: Record) -> Part:
    """The same scene as text, rendered by whole commands."""
    rows = record.rows("renderers")
    names = list(dict.fromkeys(row["name"] for row in rows))
    lines = []
    for (scene, size), own in by(rows, "scene", "size").items():
        cells = [f"{scene} {size}", count(own[0]["objects"])]
        for name in names:
            row = one(own, name=name)
            cells += [number(row["seconds"]), mib(row["peak"])] if row else ["–", "–"]
        lines.append(cells)
    head = ["scene", "objects"]
    for name in names:
        head += [f"{NAMES[name]}, s", "MiB"]
    said = []
    for name in names[1:]:
        faster = [row["faster"] for row in rows if row["name"] == name]
        said.append(f"{NAMES[name]} takes {min(faster):.2f} to {max(faster):.2f} times as long")
    text = f"{spoken(said)}." if said else "No other renderer was installed."
    shown = [{**row, "at": f"{row['scene']} {row['size']}"} for row in rows]
    draw = partial(plots.bars, shown, groups=("at", "name"), column="seconds", unit="seconds")
    return Part(text, table(head, lines), draw)


def terrain(record: Record) -> Part:
    """A raster's conversion and viewsheds, beside GDAL's."""
    rows = record.rows("terrain")
    lines = [
        [count(row["side"]), row["work"], NAMES[row["name"]], spaced(row["cap"]),
         *((row["end"], "–") if row["end"] else (number(row["seconds"]), mib(row["peak"])))]
        for row in rows
    ]  # fmt: skip
    head = ["side, pixels", "work", "program", "cap", "s", "MiB"]
    said = []
    for (side, work), own in by(rows, "side", "work").items():
        ours, other = one(own, name="bfrt"), one(own, name="gdal_viewshed")
        if ours and other and not (ours["end"] or other["end"]):
            ratio = other["seconds"] / ours["seconds"]
            said.append(f"at {side:,} pixels a side ({work}) bfrt is {times(ratio)} it")
    text = f"Beside gdal_viewshed, {spoken(said)}." if said else ""
    shown = [{**row, "at": f"{row['work']}, {row['side']:,}"} for row in rows if not row["end"]]
    draw = partial(plots.bars, shown, groups=("at", "name"), column="seconds", unit="seconds")
    return Part(text, table(head, lines), draw)
