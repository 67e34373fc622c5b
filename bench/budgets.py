"""What a budget costs: one store rendered under several, each in a cgroup of the budget's size.

::

    python bench/budgets.py rings:94 --budgets 96MiB 256MiB 1GiB --json budgets.json

Cold, marks made afresh. Told are seconds, passes over the objects, slabs of the grid and the most
that the process held. The pictures have to be the same, byte for byte. Needs root, for the cgroup.
"""

from __future__ import annotations

import argparse
import json
import tempfile
from pathlib import Path
from typing import Any

from capped import drop, run_capped
from saved import save
from stores import made

from bfrt.memory import parse_memory


def rendered(store: Path, budget: str, threads: int, folder: Path) -> dict[str, Any]:
    """The facts of one render."""
    drop(store)
    stats = folder / "stats.json"
    status, peak = run_capped(
        ["-m", "bfrt", "render", str(store), "-o", str(folder / "picture.npy"), "--memory", budget,
         "--threads", str(threads), "--fresh-marks", "--quiet", "--stats", str(stats)],
        parse_memory(budget),
    )  # fmt: skip
    if status:
        raise SystemExit(f"{store.name} {budget}: exit status {status}, peak {peak}")
    found = json.loads(stats.read_text())
    return {
        "budget": parse_memory(budget),
        "threads": threads,
        "seconds": found["seconds"],
        "passes": found["passes"],
        "slabs": found["grids"][0]["slabs"],
        "process": found["peak_rss_bytes"],
        "peak": peak,
    }


def measured(scene: str, budgets: list[str], threads: int, folder: Path) -> list[dict[str, Any]]:
    """A row for each budget."""
    name, size = scene.split(":")
    store = made(name, int(size), folder)
    rows, pictures = [], set()
    for budget in budgets:
        row = rendered(store, budget, threads, folder)
        pictures.add((folder / "picture.npy").read_bytes())
        rows.append({"scene": name, "size": int(size), **row})
        print(
            f"{scene:12} {budget:>7} {row['seconds']:8.2f} s {row['passes']:6} passes "
            f"{row['slabs']:3} slabs {row['process'] >> 20:6} MiB",
            flush=True,
        )
    if len(pictures) != 1:
        raise SystemExit(f"{scene}: the budgets made different pictures")
    return rows


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("scenes", nargs="+", help="as rings:94")
    parser.add_argument("--budgets", nargs="+", default=["96MiB", "128MiB", "256MiB", "1GiB"])
    parser.add_argument("--threads", type=int, default=2)
    parser.add_argument("--json", type=Path)
    parser.add_argument("--folder", type=Path, help="where stores are made")
    given = parser.parse_args()
    rows: list[dict[str, Any]] = []
    for scene in given.scenes:
        with tempfile.TemporaryDirectory(dir=given.folder) as folder:
            rows += measured(scene, given.budgets, given.threads, Path(folder))
        save(given.json, rows)


if __name__ == "__main__":
    main()
