"""The summary of the page: a line for each thing a reader wants to know first."""

from __future__ import annotations

from collections.abc import Callable

from reporting import beside
from reporting.parts import spaced, spoken, times
from reporting.record import Record
from reporting.sections import part_of


def lines_of(record: Record) -> list[str]:
    """At most ten lines, of what the report has."""
    return [line for said in SAID for line in [said(record)] if line]


def _of_peers(record: Record) -> str:
    rows = record.rows("peers")
    own = [row for row in rows if row["name"] == "bfrt" and not row["end"]]
    if not own:
        return ""
    most = max(own, key=lambda row: row["millions"])
    at = [row for row in rows if (row["millions"], row["cap"]) == (most["millions"], most["cap"])]
    others = [r for r in at if r["name"] != "bfrt" and r["end"] in ("", beside.KILLED)]
    told = [
        f"{beside.NAMES[row['name']]} is {row['end']}"
        if row["end"]
        else f"{beside.NAMES[row['name']]} takes {row['seconds']:.1f}"
        for row in others
    ]
    beside_it = f"; {spoken(told)}" if told else ""
    return (
        f"From a file of {most['millions']:g} million triangles to a million hits bfrt takes "
        f"{most['seconds']:.1f} seconds in {spaced(most['cap'])}{beside_it}."
    )


def _of_speed(record: Record) -> str:
    return beside.where_all_live(record.rows("peers"))


def _of_kills(record: Record) -> str:
    rows = record.rows("peers") + record.rows("particles")
    rows = [row for row in rows if row["end"] in ("", beside.KILLED)]
    if not rows:
        return ""
    own = [row for row in rows if row["name"] == "bfrt"]
    other = [row for row in rows if row["name"] != "bfrt"]
    killed = [sum(row["end"] == beside.KILLED for row in some) for some in (own, other)]
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
        part = part_of(record, name)
        return f"{part.text.split('. ')[0].rstrip('.')}." if part else ""

    return said


SAID = (_of_peers, _of_speed, _of_kills, _of_particles, *map(_of_a_part, (
    "size", "growth", "pictures", "memory", "rays", "conversion",
)))  # fmt: skip
