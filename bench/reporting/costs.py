"""What else one may ask: parts about conversions, order, levels, groups, checkpoints, clusters."""

from __future__ import annotations

from functools import partial

from reporting import plots
from reporting.kinds import Rows
from reporting.parts import Part, by, one, spoken
from reporting.record import Record
from reporting.tables import count, gigabytes, mib, millions, number, table


def conversion(record: Record) -> Part:
    """Points of several formats into a store."""
    rows = [row for row in record.rows("points") if not row["end"]]
    rows = [{**row, "rate": row["points"] / row["seconds"]} for row in rows]
    lines = [
        [row["format"], millions(row["points"]), number(row["bytes"] / 1e6), number(row["seconds"]),
         number(row["bytes"] / row["seconds"] / 1e6), millions(row["rate"]), mib(row["peak"])]
        for row in rows
    ]  # fmt: skip
    head = ["format", "M points", "MB", "s", "MB/s", "M points/s", "peak, MiB"]
    rates = [row["rate"] / 1e6 for row in rows]
    text = f"{min(rates):.2f} to {max(rates):.2f} million points a second, by format."
    shown = [{**row, "M": row["rate"] / 1e6, "n": f"{row['points'] / 1e6:g} M"} for row in rows]
    draw = partial(plots.bars, shown, groups=("format", "n"), column="M", unit="M points a second")
    return Part(text, table(head, lines), draw)


def ordering(record: Record) -> Part:
    """The end of writing a store in spatial order."""
    rows = [row for row in record.rows("ordering") if row["order"] == "spatial"]
    rows = [{**row, "rate": row["objects"] / row["closing"]} for row in rows]
    lines = [
        [
            row["kind"],
            row["shape"],
            count(row["objects"]),
            number(row["closing"]),
            millions(row["rate"]),
        ]
        for row in rows
    ]
    head = ["objects are", "they come", "objects", "the end of writing, s", "M objects/s"]
    rates = [row["rate"] / 1e6 for row in rows]
    text = f"Order is made of {min(rates):.1f} to {max(rates):.1f} million objects a second."
    shown = [{**row, "M": row["rate"] / 1e6, "at": f"{row['kind']}, {row['objects']:,}"}
             for row in rows]  # fmt: skip
    draw = partial(plots.bars, shown, groups=("at", "shape"), column="M", unit="M objects a second")
    return Part(text, table(head, lines), draw)


def order(record: Record) -> Part:
    """Treelets of a store in spatial order beside the grid."""
    rows = record.rows("tree")
    lines, said = [], []
    for (scene, size), own in by(rows, "scene", "size").items():
        pair = [one(own, refine=name) for name in ("sgb", "tree")]
        sgb, tree = (row or {} for row in pair)
        gain = sgb["tracing"] / tree["tracing"]
        said.append((gain, f"{scene} {size}"))
        cells = [format_(row[name]) for name, format_ in
                 (("tracing", number), ("bytes", gigabytes), ("passes", count), ("making", number))
                 for row in (sgb, tree)]  # fmt: skip
        lines.append([f"{scene} {size}", *cells, number(sgb["preprocess"]), number(gain)])
    head = ["scene", "tracing sgb, s", "tree, s", "sgb, GB read", "tree, GB", "sgb, passes",
            "tree, passes", "made sgb, s", "made tree, s", "marks of sgb, s", "gain"]  # fmt: skip
    worst, best = min(said), max(said)
    text = (
        f"The tree traces {best[1]} {best[0]:.2f} times as fast as the grid and {worst[1]} "
        f"{worst[0]:.2f} times."
    )
    text += "".join(_at_random(own) for own in by(record.rows("random"), "spheres").values())
    shown = [{**row, "at": f"{row['scene']} {row['size']}"} for row in rows]
    draw = partial(plots.bars, shown, groups=("at", "refine"), column="tracing", unit="tracing, s")
    return Part(text, table(head, lines), draw)


def _at_random(rows: Rows) -> str:
    pair = [one(rows, refine=name) for name in ("sgb", "tree")]
    sgb, tree = (row or {} for row in pair)
    return (
        f" From a file of {rows[0]['spheres']:,} spheres in random order to a picture it is "
        f"{sgb['seconds']:.1f} seconds by the grid, {tree['seconds']:.1f} by the tree, the "
        f"making of the order included."
    )


def levels(record: Record) -> Part:
    """Rays stored on one level and on two."""
    rows = record.rows("levels")
    lines, ratios = [], []
    for (scene, size), own in by(rows, "scene", "size").items():
        seconds = {row["lower"]: row["seconds"] for row in own}
        ratio = [seconds[1] / seconds[lower] for lower in (2, 4)]
        ratios += ratio
        lines.append([f"{scene} {size}", *map(number, seconds.values()), *map(number, ratio)])
    head = ["scene", "one level, s", "64 x 2, s", "32 x 4, s", "64 x 2, ratio", "32 x 4, ratio"]
    text = f"One level takes {min(ratios):.2f} to {max(ratios):.2f} of the time of two."
    names = {1: "one level", 2: "64 x 2", 4: "32 x 4"}
    shown = [
        {**row, "at": f"{row['scene']} {row['size']}", "on": names[row["lower"]]} for row in rows
    ]
    draw = partial(plots.bars, shown, groups=("at", "on"), column="seconds", unit="seconds")
    return Part(text, table(head, lines), draw)


def stadium(record: Record) -> Part:
    """A teapot in a hall, in one group and in two."""
    rows = record.rows("stadium")
    lines = [
        [str(row["size"]), row["refine"], str(row["groups"]), number(row["seconds"]),
         millions(row.get("box_tests"))]
        for row in rows
    ]  # fmt: skip
    head = ["teapot", "refinement", "groups", "s", "M box tests"]
    grid = [one(own, refine="sgb", groups=1) for own in by(rows, "size").values()]
    two = [one(own, refine="sgb", groups=2) for own in by(rows, "size").values()]
    pairs = zip(grid, two, strict=True)
    said = [f"{a['seconds'] / b['seconds']:.0f} times" for a, b in pairs if a and b]
    text = f"In two groups the grid is {spoken(said)} as fast as in one."
    shown = [{**row, "at": f"teapot {row['size']}",
              "n": f"groups: {row['groups']}, {row['refine']}"} for row in rows]  # fmt: skip
    draw = partial(plots.bars, shown, groups=("at", "n"), column="seconds", unit="seconds")
    return Part(text, table(head, lines), draw)


def checkpoints(record: Record) -> Part:
    """What being ready to go on costs."""
    rows = record.rows("checkpoints")
    lines, said, shown = [], [], []
    for (scene, size), own in by(rows, "scene", "size").items():
        plain = one(own, every=None)
        for row in own:
            ratio = row["seconds"] / plain["seconds"] if plain else 1.0
            every = "none" if row["every"] is None else f"every {row['every']:g} s"
            lines.append([f"{scene} {size}", every, number(row["seconds"]), number(ratio),
                          number(row["saves"]), number(row["written"] / 1e6)])  # fmt: skip
            shown.append({"at": f"{scene} {size}", "every": every, "seconds": row["seconds"]})
            if row["every"] is not None:
                said.append(f"{ratio:.2f} times as long ({scene} {size}, {every})")
    head = ["scene", "checkpoint", "s", "ratio", "saves", "MB written"]
    draw = partial(plots.bars, shown, groups=("at", "every"), column="seconds", unit="seconds")
    return Part(f"A render with a checkpoint takes {spoken(said)}.", table(head, lines), draw)


def cluster(record: Record) -> Part:
    """A process, one worker of a cluster, and two."""
    rows = record.rows("cluster")
    lines, said = [], []
    for (scene, size, refine, work), own in by(rows, "scene", "size", "refine", "work").items():
        seconds = [row["seconds"] for row in own]
        sent = own[-1]["bytes"]
        lines.append([f"{scene} {size}", str(refine), str(work), *map(number, seconds),
                      number(seconds[1] / seconds[2]), number(sent)])  # fmt: skip
        said.append(seconds[1] / seconds[2])
    head = ["scene", "refinement", "work", "a process, s", "one worker, s", "two, s",
            "gain of the second", "bytes a ray"]  # fmt: skip
    text = f"A second worker makes it {min(said):.2f} to {max(said):.2f} times as fast."
    shown = [{**row, "at": f"{row['work']}, {row['refine']}",
              "n": f"{row['workers']} workers" if row["workers"] else "a process"}
             for row in rows]  # fmt: skip
    draw = partial(plots.bars, shown, groups=("at", "n"), column="seconds", unit="seconds")
    return Part(text, table(head, lines), draw)
