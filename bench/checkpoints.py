"""What a checkpoint costs: renders with one and without, in turn, cold and capped; medians.

::

    python bench/checkpoints.py rings:94                     --every 60, by treelets
    python bench/checkpoints.py rings:94 --every 5 0         oftener; 0 is after every pass
    python bench/checkpoints.py rings:94 --refine sgb

In memory cgroups of 256 MiB (root makes them). Pictures have to be the same. A render that is over
before the interval saves nothing: then the ratio is what being ready to save costs.
"""

from __future__ import annotations

import argparse
import json
import logging
import statistics
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import stores
from capped import CAP, drop, how_capped, run_capped
from case import digest
from saved import save

import bfrt

Facts = dict[str, Any]

#: Who tells of saves, and where the system tells what a process has written.
TOLD_BY = "bfrt.checkpoint.checkpoint"
IO = Path("/proc/self/io")


class Saves(logging.Handler):
    """Collects the bytes and the seconds of saves, from what is logged of them."""

    def __init__(self) -> None:
        super().__init__(logging.DEBUG)
        self.found: list[tuple[int, float]] = []
        log = logging.getLogger(TOLD_BY)
        log.addHandler(self)
        log.setLevel(logging.DEBUG)

    def emit(self, record: logging.LogRecord) -> None:
        if record.msg.startswith("%s: saved") and isinstance(record.args, tuple):
            _, size, seconds = record.args
            self.found.append((size, seconds))


def written() -> int:
    """The bytes that this process has had written to disks."""
    lines = dict(line.split(": ") for line in IO.read_text().splitlines())
    return int(lines["write_bytes"])


def render(store: str, **settings: Any) -> Facts:
    """One render, in a process of its own."""
    saves = Saves()
    start, before = time.perf_counter(), written()
    image = bfrt.render(store, memory=CAP, **settings)
    seconds = time.perf_counter() - start
    return {
        "seconds": seconds,
        "written": written() - before,
        "saves": saves.found,
        "digest": digest(image.channels),
    }


def one(store: Path, refine: str, folder: Path, every: float | None) -> Facts:
    """The facts of a render, cold and capped."""
    drop(store)
    settings: Facts = {"store": str(store), "refine": refine, "scratch": str(folder)}
    if refine != "tree":
        settings["fresh_marks"] = True
    if every is not None:
        settings |= {"checkpoint": str(folder / "kept"), "every": every}
    facts = folder / "facts.json"
    status, peak = run_capped([__file__, "--one", json.dumps(settings), str(facts)], CAP)
    if status:
        raise SystemExit(f"{settings}: exit status {status}, peak {peak}")
    found: Facts = json.loads(facts.read_text())
    return found


def told(every: float | None, plain: list[Facts], runs: list[Facts]) -> str:
    """What came of the renders with a checkpoint, beside those without."""
    seconds = statistics.median(run["seconds"] for run in runs)
    bare = statistics.median(run["seconds"] for run in plain)
    row = f"{seconds:8.3f} s, written {statistics.median(run['written'] for run in runs):13,} bytes"
    if every is None:
        return f"without  {row}"
    row = f"every {every:<3g}{row}, ratio {seconds / bare:.4f}"
    saves = [save for run in runs for save in run["saves"]]
    if not saves:
        return f"{row}, no save"
    took = [each for _, each in saves]
    return (
        f"{row}, {len(saves) / len(runs):.1f} saves of "
        f"{statistics.median(size for size, _ in saves):,.0f} bytes (most "
        f"{max(size for size, _ in saves):,}), each {statistics.median(took):.4f} s (most "
        f"{max(took):.4f}), all {sum(took) / len(runs):.3f} s and "
        f"{sum(size for size, _ in saves) // len(runs):,} bytes a run"
    )


def facts_of(every: float | None, runs: list[Facts]) -> Facts:
    """Medians of the runs; no interval is None."""
    row = {name: statistics.median(run[name] for run in runs) for name in ("seconds", "written")}
    return {"every": every, **row, "saves": sum(len(run["saves"]) for run in runs) / len(runs)}


def measure(scene: str, options: argparse.Namespace, folder: Path) -> list[Facts]:
    """Render a scene in all ways in turn; print what came of each, and return it."""
    name, size = scene.split(":")
    store = stores.made(name, int(size), folder, stores.ORDERS[options.refine])
    ways: list[float | None] = [None, *options.every]
    runs: dict[float | None, list[Facts]] = {every: [] for every in ways}
    for _ in range(options.runs):
        for every in ways:
            runs[every].append(one(store, options.refine, folder, every))
    if len({run["digest"] for each in runs.values() for run in each}) != 1:
        raise SystemExit("the pictures differ")
    print(f"{scene}, {options.refine}, {options.runs} runs each, capped by {how_capped()}")
    for every in ways:
        print(told(every, runs[None], runs[every]), flush=True)
    given = {"scene": name, "size": int(size), "refine": options.refine}
    return [{**given, **facts_of(every, found)} for every, found in runs.items()]


def main() -> None:
    if sys.argv[1:2] == ["--one"]:
        settings, facts = sys.argv[2:]
        Path(facts).write_text(json.dumps(render(**json.loads(settings))))
        return
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("scene", nargs="+", help="NAME:SIZE")
    parser.add_argument("--every", type=float, nargs="+", default=[60.0], help="seconds (60)")
    parser.add_argument("--runs", type=int, default=3, help="of each, in turn (3)")
    parser.add_argument("--refine", choices=stores.ORDERS, default="tree")
    parser.add_argument("--json", type=Path)
    parser.add_argument("--folder", type=Path, help="where stores and checkpoints lie meanwhile")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory(dir=options.folder) as folder:
        rows: list[Facts] = []
        for scene in options.scene:
            rows += measure(scene, options, Path(folder))
            save(options.json, rows)


if __name__ == "__main__":
    main()
