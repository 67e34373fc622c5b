"""How fast, how large, how much memory and how it grows: parts about bfrt by itself."""

from __future__ import annotations

from functools import partial
from typing import Any

from reporting import plots
from reporting.beside import NAMES
from reporting.flat import REFINEMENTS
from reporting.kinds import Row, Rows
from reporting.parts import Part, by, one, paper_gains, power, spoken
from reporting.record import Record
from reporting.tables import count, gigabytes, mib, millions, number, table


def gain_rows(record: Record, disk: int | None = None) -> Rows:
    """A row for each scene and size: seconds of each refinement and gains over base."""
    rows = [row for row in record.rows("refinements") if row["disk"] == disk]
    paper = paper_gains()
    found = []
    for (scene, size), own in by(rows, "scene", "size").items():
        of = {row["refine"]: row for row in own}
        line: Row = {"scene": scene, "size": size, "objects": own[0]["objects"], "of": of}
        for name in REFINEMENTS[1:]:
            if name in of:
                line[name] = of["base"]["seconds"] / of[name]["seconds"]
                line[f"paper {name}"] = paper.get((str(scene), int(str(size))), {}).get(name)
        found.append(line)
    return found


def largest(rows: Rows) -> Rows:
    """Of each scene the row of the most objects."""
    return [max(own, key=lambda row: row["objects"]) for own in by(rows, "scene").values()]


def drawable(rows: Rows) -> Rows:
    """Rows with all gains; without one it is 0, an empty bar."""
    return [{**dict.fromkeys(REFINEMENTS, 0.0), **row} for row in rows]


def pictures(record: Record) -> Part:
    """Seconds of a picture of each scene with each refinement."""
    rows = gain_rows(record)
    lines = []
    for row in rows:
        of = row["of"]
        cells = [number(of[name]["seconds"] if name in of else None) for name in REFINEMENTS]
        read = [gigabytes(of[name]["bytes"] if name in of else None) for name in ("base", "sgb")]
        gain = [number(row.get(name)) for name in ("sgb", "paper sgb", "tree")]
        lines.append([f"{row['scene']} {row['size']}", count(row["objects"]), *cells, *gain, *read])
    head = ["scene", "objects", "base, s", "sg, s", "sgb, s", "tree, s", "gain sgb", "the paper's",
            "gain tree", "base, GB read", "sgb, GB read"]  # fmt: skip
    most = largest(rows)
    told = spoken(f"{row['scene']} {row['size']} {row['sgb']:.2f}" for row in most)
    sgb = [row["of"]["sgb"]["seconds"] / row["objects"] * 1e6 for row in most]
    text = (
        f"At its largest size here a scene takes {min(sgb):.2f} to {max(sgb):.2f} seconds a "
        f"million objects with sgb. The gain of sgb over base is, at these sizes: {told}."
    )
    return Part(text, table(head, lines), partial(plots.gains, drawable(most)))


def slow_disk(record: Record) -> Part:
    """The same where the disk is slow."""
    rows = [row for disk in disks(record) for row in gain_rows(record, disk)]
    lines = []
    for row in rows:
        seconds = [number(row["of"][n]["seconds"]) if n in row["of"] else "–" for n in REFINEMENTS]
        gains = [number(row.get(name)) for name in ("sg", "sgb", "paper sgb", "tree")]
        lines.append([f"{row['scene']} {row['size']}", *seconds, *gains])
    head = ["scene", "base, s", "sg, s", "sgb, s", "tree, s", "gain sg", "gain sgb", "the paper's",
            "gain tree"]  # fmt: skip
    gains = [row["sgb"] for row in rows]
    text = (
        f"With {spoken(f'{disk / 1e6:.0f} MB' for disk in disks(record))} a second sgb is "
        f"{min(gains):.1f} to {max(gains):.1f} times as fast as base."
    )
    return Part(text, table(head, lines), partial(plots.gains, drawable(rows)))


def disks(record: Record) -> list[int]:
    """The speeds of slowed disks that were measured."""
    return sorted({row["disk"] for row in record.rows("refinements") if row["disk"]})


def rays(record: Record) -> Part:
    """Rays a second of a scene that is loaded."""
    rows = [{**row, "scene": "PLY"} for row in record.rows("steady")]
    rows += [
        {**row, "scene": "arrays", "name": f"bfrt {row['name']}"}
        if row["name"] in REFINEMENTS
        else {**row, "scene": "arrays"}
        for row in record.rows("loaded")
    ]
    names = list(dict.fromkeys(row["name"] for row in rows))
    lines = [
        [str(scene), str(kind)]
        + [millions((one(own, name=name) or {}).get("rate")) for name in names]
        for (scene, kind), own in by(rows, "scene", "rays").items()
    ]
    head = ["terrain from", "rays", *(f"{NAMES.get(name, name)}, M rays/s" for name in names)]
    own = [row for row in rows if row["name"].startswith("bfrt")]
    best = max(own, key=lambda row: row["rate"])
    text = (
        f"The fastest of bfrt is {best['rate'] / 1e6:.2f} million {best['rays']} rays a second "
        f"({best['name']}). Programs that do nothing but keep a scene in memory are faster at this."
    )
    shown = [{**row, "at": f"{row['rays']}, {row['scene']}", "M": row["rate"] / 1e6}
             for row in rows]  # fmt: skip
    draw = partial(plots.bars, shown, groups=("at", "name"), column="M", unit="M rays a second")
    return Part(text, table(head, lines), draw)


def memory(record: Record) -> Part:
    """What a smaller budget costs."""
    rows = [row for row in record.rows("budgets") if "frame" not in row]
    lines = [
        [f"{row['scene']} {row['size']}", mib(row["budget"]), str(row["threads"]),
         number(row.get("seconds")), count(row["passes"]), count(row.get("slabs")),
         mib(row.get("process"))]
        for row in rows
    ]  # fmt: skip
    head = ["scene", "budget, MiB", "threads", "s", "passes", "slabs", "process's peak, MiB"]
    timed = [{**row, "at": row["budget"] / 2**20, "of": f"{row['scene']} {row['size']}"}
             for row in rows if "seconds" in row]  # fmt: skip
    said = [_cost(own) for own in by(timed, "of").values() if len(own) > 1]
    said.append("The pictures of a scene are the same, byte for byte, and no render was killed.")
    draw = partial(
        plots.lines, timed, axes=("at", "seconds"), series="of", labels=("budget, MiB", "seconds")
    )
    return Part(" ".join(said), table(head, lines), draw if timed else None)


def _cost(rows: Rows) -> str:
    least, most = (pick(rows, key=lambda row: row["budget"]) for pick in (min, max))
    ratio = least["seconds"] / most["seconds"]
    return (
        f"{least['of']} takes {ratio:.1f} times as long in {least['at']:.0f} MiB as in "
        f"{most['at']:,.0f}."
    )


def size(record: Record) -> Part:
    """From nothing to pictures of huge scenes, each step beside a sequential read of the store."""
    rows = record.rows("billion")
    scenes = by(rows, "scene")
    lines, shown, said = [], [], []
    for (scene,), own in scenes.items():
        read = one(own, label="sequential read")["whole"]
        for row in own:
            if row["step"] == "sliced":
                continue
            made = row["step"] == "spd"
            seconds = row["whole"]
            gained = one(own, label=f"{row['label']} base")
            tracing = row["seconds"] - row["preprocess"] if row["step"] == "render" else None
            gain = gained["sweep"] * row["sweeps"] / tracing if gained and tracing else None
            lines.append([
                str(scene), "making the store" if made else f"picture {row['label']}"
                if row["step"] == "render" else row["label"], number(seconds),
                number(seconds / read), gigabytes(row.get("bytes_read", row.get("bytes"))),
                number(row.get("preprocess")), number(tracing), number(gain),
            ])  # fmt: skip
            step = {"spd": "making the store", "read": "reading it"}.get(row["step"], "a picture")
            shown.append({"scene": scene, "step": step, "seconds": seconds})
        said.append(_whole(str(scene), own))
    head = ["scene", "step", "s", "sequential reads", "GB", "marks, s", "tracing, s", "gain of sgb"]
    draw = partial(plots.bars, shown, groups=("scene", "step"), column="seconds", unit="seconds")
    return Part(" ".join(said), table(head, lines), draw)


def _whole(scene: str, rows: Rows) -> str:
    made: Any = one(rows, label="create")
    picture = next(row for row in rows if row["step"] == "render")
    seconds = made["whole"] + picture["whole"]
    return (
        f"{scene}, {made['objects']:,} objects in {made['bytes'] / 1e9:.1f} GB, takes "
        f"{seconds / 60:.1f} minutes from nothing to its first picture, in 256 MiB."
    )


def growth(record: Record) -> Part:
    """Seconds of tracing against objects."""
    rows = sorted(record.rows("tracing"), key=lambda row: row["objects"])
    lines = [[f"{row['scene']} {row['size']}", count(row["objects"]), number(row["seconds"])]
             for row in rows]  # fmt: skip
    found = power(rows)
    text = f"Tracing takes {rows[0]['seconds']:.2f} seconds of {rows[0]['objects']:,} objects"
    if found is not None:
        text += (
            f" and {rows[-1]['seconds']:.2f} of {rows[-1]['objects']:,}: seconds grow like objects "
            f"to the power of {found:.2f}"
        )
    draw = partial(plots.growth, rows, power=found)
    return Part(f"{text}.", table(["scene", "objects", "tracing, s"], lines), draw)


def resolution(record: Record) -> Part:
    """Seconds, marks included, of free and limited grids."""
    rows = record.rows("growth")
    lines, free = [], []
    for (scene, of_size), own in by(rows, "scene", "size").items():
        at = {row["grid"]: row for row in own}
        lines.append([f"{scene} {of_size}", count(own[0]["objects"]),
                      *(number(at[grid]["seconds"]) for grid in ("free", "128"))])  # fmt: skip
        free.append(at["free"])
    powers = {scene: power(own) for (scene,), own in by(free, "scene").items()}
    told = spoken(f"{scene} {found:.2f}" for scene, found in powers.items() if found is not None)
    text = f"Whole renders grow like objects to these powers: {told}." if told else ""
    head = ["scene", "objects", "free grid, s", "128 voxels, s"]
    draw = partial(plots.lines, free, axes=("objects", "seconds"), series="scene",
                   labels=("objects", "seconds, marks included"))  # fmt: skip
    return Part(text, table(head, lines), draw)
