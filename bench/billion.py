"""The paper's tables for huge data: a store of up to a billion objects, from nothing to picture.

::

    python bench/billion.py mount:14 rings:368 --views rings368m --folder /data --json billion.json

Each step is a process of its own inside a memory cgroup of 256 MiB, its files dropped from the page
cache before: making the store; marks and picture with sgb; the other views, marks there; base and
sg. These are run on a slice, for they take hours: their marks, and `SWEEPS` of their sweeps, whose
seconds are multiplied by the sweeps that sgb has made. The unit is one sequential read of the
store. Needs root, for the cgroup, and the disk: 40 GB for rings 368.
"""

from __future__ import annotations

import argparse
import json
import tempfile
import time
from pathlib import Path
from typing import Any

from capped import CAP, drop, run_capped
from saved import save

#: Sweeps of base that are timed.
SWEEPS = 2

#: What a step's process runs.
CASE = str(Path(__file__).with_name("case.py"))

Facts = dict[str, Any]


def step(case: str, folder: Path, store: Path, /, **settings: Any) -> Facts:
    """Run a case, cold and capped: its facts, and its seconds as a whole process."""
    if store.exists():
        drop(store)
    facts = folder / "facts.json"
    start = time.perf_counter()
    status, peak = run_capped([CASE, case, json.dumps(settings), str(facts)], CAP)
    if status:
        raise SystemExit(f"{store.name} {case} {settings}: exit status {status}, peak {peak}")
    whole = time.perf_counter() - start
    return {"step": case, "whole": whole, "peak": peak, **json.loads(facts.read_text())}


def measured(scene: str, size: int, views: list[str], folder: Path, pictures: Path) -> list[Facts]:
    """All steps of a store."""
    store = folder / f"{scene}{size}.bfrt"
    rows: list[Facts] = []

    def note(label: str, case: str, **settings: Any) -> None:
        done = step(case, folder, store, **settings)
        rows.append({"scene": f"{scene} {size}", "label": label, **done})
        print(json.dumps(rows[-1]), flush=True)

    options = {"hash": "jenkins"} if scene == "mount" else {}
    note("create", "spd", name=scene, size=size, target=str(store), **options)
    note("sequential read", "read", store=str(store))
    labels = {"": f"{scene}{size}"} | {v: v for v in views if v.startswith(f"{scene}{size}")}
    given = {"store": str(store), "memory": CAP}
    for view, label in labels.items():
        picture = str(pictures / f"{label}.png")
        note(label, "render", **given, view=view, picture=picture, fresh_marks=not view)
    for refine in ("base", "sg"):  # after these, for they make marks of their own
        for view, label in labels.items():
            note(f"{label} {refine}", "sliced", **given, view=view, sweeps=SWEEPS, refine=refine)
    return rows


def summary(rows: list[Facts]) -> str:
    """A store's rows in units of its sequential read, and gains over the extrapolated base."""
    unit = next(row["whole"] for row in rows if row["step"] == "read")
    created = next(row["whole"] for row in rows if row["step"] == "spd")
    renders = [row for row in rows if row["step"] == "render"]
    marking = renders[0]["passes"] - renders[0]["sweeps"]
    lines = [f"created in {created:.1f} s; one sequential read {unit:.1f} s"]
    for row in renders:
        preprocess = row["phases"]["preprocess"]
        tracing = row["seconds"] - preprocess
        lines.append(
            f"{row['label']}: {row['whole']:.1f} s, {row['bytes_read'] / 1e9:.1f} GB read; "
            f"preprocess {preprocess:.1f} s ({preprocess / unit:.2f}), {marking} passes; "
            f"tracing {tracing:.1f} s ({tracing / unit:.2f}), {row['sweeps']} sweeps"
        )
        for refine in ("base", "sg"):
            part = next(r for r in rows if r["label"] == f"{row['label']} {refine}")
            sweep = part["sweep"]
            gain = sweep * row["sweeps"] / tracing
            lines.append(
                f"    {refine}: {sweep:.1f} s a sweep; tracing about "
                f"{sweep * row['sweeps']:.0f} s, of which the gain is {gain:.2f}; "
                f"preprocess {part['preprocess']:.0f} s"
            )
    return "\n".join(lines)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("scenes", nargs="+", help="as rings:368, one store at a time")
    parser.add_argument("--views", nargs="*", default=[], help="other views, as rings368m")
    parser.add_argument("--folder", type=Path, help="where stores are made")
    parser.add_argument("--pictures", type=Path, default=Path(), help="where pictures are put")
    parser.add_argument("--json", type=Path)
    arguments = parser.parse_args()
    rows: list[Facts] = []
    for wanted in arguments.scenes:
        scene, _, size = wanted.partition(":")
        with tempfile.TemporaryDirectory(dir=arguments.folder) as folder:
            found = measured(scene, int(size), arguments.views, Path(folder), arguments.pictures)
        print(summary(found), flush=True)
        rows += found
        save(arguments.json, rows)


if __name__ == "__main__":
    main()
