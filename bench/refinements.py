"""The paper's table 1: what its refinements gain, scene by scene and size by size.

::

    python bench/refinements.py --sizes 3 --json table1.json --plot table1.png

makes each scene as a store, and renders it with each refinement, its marks made afresh, inside a
memory cgroup of 256 MiB and with the store dropped from the page cache before. A gain is the time
of base over that of the refinement; the hierarchy's time counts as part of sgb's. The tree has a
store of its own, in spatial order, the making of which is not counted. The script prints a row
as soon as it is measured, with the paper's gains beside ours. Needs root, for the cgroup.
``--disk 200MB`` measures what the gains are where the disk gives 200 MB a second.
"""

from __future__ import annotations

import argparse
import csv
import json
import shutil
import statistics
import tempfile
import time
from pathlib import Path
from typing import Any

from capped import CAP, drop, run_capped
from saved import save
from stores import ORDERS, made

import bfrt
from bfrt.memory import parse_memory

HEAD = (
    "scene    size    objects  create s   base s     sg s    sgb s   tree s    sg   sgb  tree  "
    "paper: sg   sgb   GB base      sg     sgb    tree"
)


def paper_rows() -> list[dict[str, Any]]:
    """The paper's table."""
    with (Path(__file__).parent / "paper-table1.csv").open() as file:
        rows = csv.DictReader(line for line in file if not line.startswith("#"))
        return [
            {
                "scene": r["scene"],
                "size": int(r["size"]),
                "sg": float(r["sg"]),
                "sgb": float(r["sgb"]),
            }
            for r in rows
        ]


def rendered(store: Path, refine: str, folder: Path, rate: int | None) -> dict[str, Any]:
    """The statistics of one render, cold and capped, its disk too if there is a rate."""
    drop(store)
    stats = folder / "stats.json"
    arguments = [
        "-m", "bfrt", "render", str(store), "-o", str(folder / f"{refine}.npy"), "--memory",
        "256MiB", "--refine", refine, "--quiet", "--stats", str(stats),
        *([] if refine == "tree" else ["--fresh-marks"]),
    ]  # fmt: skip
    status, peak = run_capped(arguments, CAP, (folder, rate) if rate else None)
    if status:
        raise SystemExit(f"{store.name} {refine}: exit status {status}, peak {peak}")
    found = json.loads(stats.read_text())
    phases = found["phases"].values()
    return {
        "seconds": found["seconds"] + found["hierarchy_seconds"],
        "bytes": sum(p["bytes_read"] + p["bytes_written"] for p in phases),
        "seeks": sum(p["seeks"] for p in phases),
        "phases": {name: p["seconds"] for name, p in found["phases"].items()},
        "passes": found["passes"],
        "rays": found["rays"],
        "peak": peak,
    }


def measured(name: str, size: int, runs: int, folder: Path, rate: int | None) -> dict[str, Any]:
    """One row: medians of the runs, in turn."""
    start = time.perf_counter()
    stores = {"given": made(name, size, folder)}
    made_in = time.perf_counter() - start
    stores["spatial"] = made(name, size, folder, "spatial")
    row: dict[str, Any] = {"scene": name, "size": size, "disk": rate, "create": made_in}
    row["objects"] = bfrt.open(stores["given"]).objects
    all_runs = [
        {r: rendered(stores[order], r, folder, rate) for r, order in ORDERS.items()}
        for _ in range(runs)
    ]
    if len({json.dumps(run[r]["rays"]) for run in all_runs for r in ORDERS}) != 1:
        raise SystemExit(f"{name} {size}: the refinements sent different rays")
    pictures = {(folder / f"{r}.npy").read_bytes() for r in ORDERS}
    if len(pictures) != 1:
        raise SystemExit(f"{name} {size}: the refinements made different pictures")
    for refine in ORDERS:
        runs_of = [run[refine] for run in all_runs]
        middle = statistics.median_low(run["seconds"] for run in runs_of)
        row[refine] = next(run for run in runs_of if run["seconds"] == middle)
    for store in stores.values():
        shutil.rmtree(store)
    return row


def is_of(row: dict[str, Any], paper: dict[str, Any], rate: int | None) -> bool:
    """Whether a row is that of the paper, measured on a disk of this rate."""
    return (row["scene"], row["size"], row["disk"]) == (paper["scene"], paper["size"], rate)


def text_of(row: dict[str, Any], paper: dict[str, Any]) -> str:
    base, sg, sgb, tree = (row[r]["seconds"] for r in ORDERS)
    gigabytes = " ".join(f"{row[r]['bytes'] / 1e9:7.2f}" for r in ORDERS)
    return (
        f"{row['scene']:7} {row['size']:5} {row['objects']:10,} {row['create']:9.2f} {base:8.2f} "
        f"{sg:8.2f} {sgb:8.2f} {tree:8.2f} {base / sg:5.2f} {base / sgb:5.2f} {base / tree:5.2f} "
        f"     {paper['sg']:5.2f} {paper['sgb']:5.2f}   {gigabytes}"
    )


def plot(rows: list[dict[str, Any]], path: Path) -> None:
    """Gain against objects, ours and the paper's."""
    import matplotlib

    matplotlib.use("svg" if path.suffix == ".svg" else "agg")
    from matplotlib import pyplot

    paper = {(r["scene"], r["size"]): r for r in paper_rows()}
    figure, axes = pyplot.subplots(1, 2, figsize=(11, 4.5), sharey=True)
    for axis, refine in zip(axes, ("sg", "sgb"), strict=True):
        for number, name in enumerate(sorted({r["scene"] for r in rows})):
            own = sorted((r for r in rows if r["scene"] == name), key=lambda r: r["objects"])
            objects = [r["objects"] for r in own]
            gains = [r["base"]["seconds"] / r[refine]["seconds"] for r in own]
            axis.plot(objects, gains, "o-", color=f"C{number}", label=name)
            theirs = [paper[name, r["size"]][refine] for r in own]
            axis.plot(objects, theirs, "x:", color=f"C{number}", alpha=0.6)
        axis.set(xscale="log", xlabel="objects", title=f"gain of {refine} over base")
        axis.axhline(1.0, color="grey", linewidth=0.5)
    axes[0].set_ylabel("times as fast (dotted: the paper)")
    axes[1].legend(fontsize="small")
    figure.tight_layout()
    figure.savefig(path)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--sizes", type=int, default=2, help="of each scene, the smallest first")
    parser.add_argument(
        "--scenes", nargs="*", default=bfrt.spd.NAMES, help="as rings, or rings:94 for that size"
    )
    parser.add_argument("--runs", type=int, default=1)
    parser.add_argument(
        "--json", type=Path, help="write all that was measured; adds to what is there"
    )
    parser.add_argument("--plot", type=Path, help="draw what the JSON file has")
    parser.add_argument("--folder", type=Path, help="where stores are made")
    parser.add_argument("--disk", type=parse_memory, help="what it gives a second, as 200MB")
    arguments = parser.parse_args()
    done: list[dict[str, Any]] = []
    if arguments.json and arguments.json.exists():
        done = json.loads(arguments.json.read_text())
    print(HEAD, flush=True)
    for wanted in arguments.scenes:
        name, _, size = wanted.partition(":")
        rows = [row for row in paper_rows() if row["scene"] == name]
        if size:
            rows = [row for row in rows if row["size"] == int(size)]
        for paper in rows if size else rows[: arguments.sizes]:
            row = next((r for r in done if is_of(r, paper, arguments.disk)), None)
            if row is None:
                with tempfile.TemporaryDirectory(dir=arguments.folder) as folder:
                    row = measured(
                        name, paper["size"], arguments.runs, Path(folder), arguments.disk
                    )
                done.append(row)
                save(arguments.json, done)
            print(text_of(row, paper), flush=True)
    if arguments.plot:
        plot([row for row in done if row["disk"] == arguments.disk], arguments.plot)


if __name__ == "__main__":
    main()
