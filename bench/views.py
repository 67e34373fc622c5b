"""What many views at once cost, against as many renders of one: cold, and in a memory cgroup.

::

    python bench/views.py --size 135 --views 36 --json views.json

makes rings as a store, and its marks; then renders the views of a turn by one call, and some of
them by a call of their own each, inside a cgroup of `--memory` and with the store dropped from the
page cache before each. A part of the views is enough (`--alone`): what all would take is their mean
times the number. The pictures have to be the same. Needs root, for the cgroup.
"""

from __future__ import annotations

import argparse
import json
import statistics
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from capped import drop, run_capped
from stores import made

import bfrt
from bfrt.memory import parse_memory

#: The least part of the cost of single renders that a turn is wanted to have.
WANTED = 1 / 3


def rendered(store: Path, folder: Path, memory: str, asked: Sequence[str]) -> dict[str, Any]:
    """The statistics of one command, cold and capped."""
    drop(store)
    stats = folder / "stats.json"
    arguments = [
        "-m", "bfrt", "render", str(store), "--memory", memory, "--quiet", "--stats", str(stats),
        *asked,
    ]  # fmt: skip
    status, peak = run_capped(arguments, parse_memory(memory))
    if status:
        raise SystemExit(f"{' '.join(asked)}: exit status {status}, peak {peak}")
    found = json.loads(stats.read_text())
    phases = found["phases"].values()
    return {
        "seconds": found["seconds"],
        "bytes": sum(p["bytes_read"] + p["bytes_written"] for p in phases),
        "seeks": sum(p["seeks"] for p in phases),
        "sweeps": sum(depth["passes"] for depth in found["depths"]),
        "rays": found["rays"],
        "peak": peak,
    }


def lines_of(views: Sequence[bfrt.Camera]) -> str:
    """A file of views, with the digits that tell them apart."""
    rows = [[*view.eye, *view.at, *view.up, view.angle] for view in views]
    return "".join(" ".join(map(repr, row)) + "\n" for row in rows)


def chosen(count: int, some: int) -> list[int]:
    """Numbers of views that are rendered alone, evenly parted."""
    return sorted({number * count // some for number in range(min(some, count))})


def measured(store: Path, views: Sequence[bfrt.Camera], folder: Path, options: Any) -> Any:
    """The row of a store: together, alone, and how they compare."""
    side = str(options.pixels)
    size = ["--resolution", side, side]
    (folder / "views.txt").write_text(lines_of(views))
    files = [*size, "-o", str(folder / "view-{}.npy"), "--views", str(folder / "views.txt")]
    together = rendered(store, folder, options.memory, files)
    print(f"{len(views)} views together: {told(together)}", flush=True)
    alone = []
    for number in chosen(len(views), options.alone):
        (folder / "one.txt").write_text(lines_of(views[number : number + 1]))
        one = [*size, "-o", str(folder / "alone-{}.npy"), "--views", str(folder / "one.txt")]
        alone.append(rendered(store, folder, options.memory, one))
        same = (folder / "alone-0.npy").read_bytes()
        if same != (folder / f"view-{number}.npy").read_bytes():
            raise SystemExit(f"view {number}: found other pixels alone than with the others")
        print(f"view {number} alone: {told(alone[-1])}", flush=True)
    each = {name: statistics.mean(run[name] for run in alone) for name in ("seconds", "bytes")}
    parts = {name: together[name] / (each[name] * len(views)) for name in each}
    return {"together": together, "alone": alone, "parts": parts}


def told(run: dict[str, Any]) -> str:
    return (
        f"{run['seconds']:.1f} s, {run['bytes'] / 1e9:.2f} GB, {run['sweeps']} sweeps, "
        f"peak {run['peak'] / 2**20:.0f} MiB"
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--size", type=int, default=135, help="of rings (135)")
    parser.add_argument("--views", type=int, default=36, help="of a turn (36)")
    parser.add_argument("--alone", type=int, default=6, help="views that are rendered alone (6)")
    parser.add_argument("--pixels", type=int, default=512, help="a side (512)")
    parser.add_argument("--order", choices=("given", "spatial"), default="given")
    parser.add_argument("--memory", default="256MiB")
    parser.add_argument("--folder", type=Path, help="where the store is kept")
    parser.add_argument("--json", type=Path, help="write the numbers")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory(dir=options.folder) as name:
        folder = Path(name)
        store = made("rings", options.size, options.folder or folder, options.order)
        views = bfrt.turntable(store, options.views)
        small = ["--resolution", "8", "8", "-o", str(folder / "marks.npy")]
        rendered(store, folder, options.memory, small)  # which makes the marks
        row = measured(store, views, folder, options)
    seconds, size = (row["parts"][key] for key in ("seconds", "bytes"))
    reached = "less" if seconds < WANTED else "no less"
    print(f"{seconds:.3f} of the seconds and {size:.3f} of the bytes: {reached} than a third")
    if options.json is not None:
        options.json.write_text(json.dumps({**vars_of(options), **row}, indent=1) + "\n")


def vars_of(options: argparse.Namespace) -> dict[str, Any]:
    """The options, ready for JSON."""
    return {name: str(v) if isinstance(v, Path) else v for name, v in vars(options).items()}


if __name__ == "__main__":
    main()
