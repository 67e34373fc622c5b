"""The paper's tables for huge data: a store of up to a billion objects, from nothing to picture.

::

    python bench/billion.py mount:14 rings:368 --views rings368m --folder /data --json billion.json

Each step is a process of its own inside a memory cgroup of 256 MiB, its files dropped from the page
cache before: making the store; marks and picture with sgb; the other views, marks there; base and
sg. These are run on a slice, for they take hours: `PASSES` of their sweeps, whose seconds are
multiplied by the sweeps that sgb has made, and for the marks by the passes that these took. The
unit is one sequential read of the store. Needs root, for the cgroup, and the disk: 40 GB for rings
368.
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

from capped import CAP, drop, run_capped

import bfrt
from bfrt.scheduler import Progress

#: Sweeps of base that are timed.
PASSES = 2

#: What the child process is told: a step's name, and its settings as JSON.
CHILD = "--step"

Facts = dict[str, Any]


def create(scene: str, size: int, store: str) -> Facts:
    options = {"hash": "jenkins"} if scene == "mount" else {}
    made = bfrt.spd.scene(scene, size, **options).write(store)
    return {"objects": made.objects, "bytes": made.bytes}


def read(store: str) -> Facts:
    """One sequential read of all files."""
    buffer = bytearray(1 << 20)
    total = 0
    for path in sorted(Path(store).rglob("*")):
        if path.is_file():
            with path.open("rb", buffering=0) as file:
                while got := file.readinto(buffer):
                    total += got
    return {"bytes": total}


def render(store: str, fresh: bool, view: str, picture: str) -> Facts:
    camera = bfrt.spd.VIEWS[view] if view else None
    image = bfrt.render(store, memory=CAP, camera=camera, fresh_marks=fresh)
    image.save(picture)
    found = image.stats.as_dict()
    return {
        "seconds": found["seconds"],
        "phases": {name: phase["seconds"] for name, phase in found["phases"].items()},
        "bytes_read": sum(phase["bytes_read"] for phase in found["phases"].values()),
        "seeks": sum(phase["seeks"] for phase in found["phases"].values()),
        "sweeps": sum(depth["passes"] for depth in found["depths"]),
        "marking": found["passes"] - sum(depth["passes"] for depth in found["depths"]),
        "rays": found["rays"],
        "grids": found["grids"],
        "hierarchy": found["hierarchy_seconds"],
        "peak": found["peak_rss_bytes"],
    }


def sliced(store: str, refine: str, view: str) -> Facts:
    """Seconds of a sweep, marks there: the first ones, then no more."""
    times: list[float] = []

    def tell(_: Progress) -> bool:
        times.append(time.perf_counter())
        return len(times) <= PASSES

    camera = bfrt.spd.VIEWS[view] if view else None
    try:
        bfrt.render(store, memory=CAP, camera=camera, refine=refine, progress=tell)
    except bfrt.Cancelled:
        return {"sweep": (times[-1] - times[0]) / PASSES}
    raise SystemExit(f"{refine} was done before its slice was")


STEPS = {"create": create, "read": read, "render": render, "sliced": sliced}


def step(name: str, folder: Path, store: Path, *settings: Any) -> Facts:
    """Run a step, cold and capped: its facts, and its seconds as a whole process."""
    if store.exists():
        drop(store)
    facts = folder / "facts.json"
    given = [__file__, CHILD, name, str(facts), json.dumps([*settings])]
    start = time.perf_counter()
    status, peak = run_capped(given, CAP)
    if status:
        raise SystemExit(f"{store.name} {name} {settings}: exit status {status}, peak {peak}")
    return {"step": name, "whole": time.perf_counter() - start, **json.loads(facts.read_text())}


def measured(scene: str, size: int, views: list[str], folder: Path, pictures: Path) -> list[Facts]:
    """All steps of a store."""
    store = folder / f"{scene}{size}.bfrt"
    rows: list[Facts] = []

    def note(label: str, name: str, *settings: Any) -> Facts:
        rows.append(
            {"scene": f"{scene} {size}", "label": label, **step(name, folder, store, *settings)}
        )
        print(json.dumps(rows[-1]), flush=True)
        return rows[-1]

    note("create", "create", scene, size, str(store))
    note("sequential read", "read", str(store))
    for view in ["", *(view for view in views if view.startswith(f"{scene}{size}"))]:
        label = view or f"{scene}{size}"
        picture = str(pictures / f"{label}.png")
        note(label, "render", str(store), not view, view, picture)
        for refine in ("base", "sg"):
            note(f"{label} {refine}", "sliced", str(store), refine, view)
    return rows


def summary(rows: list[Facts]) -> str:
    """A store's rows in units of its sequential read, and gains over the extrapolated base."""
    unit = next(row["whole"] for row in rows if row["step"] == "read")
    created = next(row["whole"] for row in rows if row["step"] == "create")
    renders = [row for row in rows if row["step"] == "render"]
    marking = renders[0]["marking"]
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
            sweep = next(r["sweep"] for r in rows if r["label"] == f"{row['label']} {refine}")
            gain = sweep * row["sweeps"] / tracing
            lines.append(
                f"    {refine}: {sweep:.1f} s a sweep; tracing about "
                f"{sweep * row['sweeps']:.0f} s, of which the gain is {gain:.2f}; "
                f"preprocess about {sweep * marking:.0f} s"
            )
    return "\n".join(lines)


def main() -> None:
    if sys.argv[1:2] == [CHILD]:
        name, facts, settings = sys.argv[2:]
        Path(facts).write_text(json.dumps(STEPS[name](*json.loads(settings))))
        return
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
        if arguments.json:
            arguments.json.write_text(json.dumps(rows, indent=1) + "\n")


if __name__ == "__main__":
    main()
