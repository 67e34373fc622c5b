"""How grids are cut: the paper's table 2, its supplement's figure 1, and a teapot in a stadium.

::

    python bench/partitions.py levels   --scenes rings:94 tree:21   the cost of two levels
    python bench/partitions.py growth   --scenes rings:7,20,36,94   free and limited resolution
    python bench/partitions.py tracing  --scenes rings:36,94,368    seconds with marks there
    python bench/partitions.py stadium  --size 60                   one group, and two

Each render runs inside a memory cgroup of 256 MiB with the store dropped from the page cache
before, its marks made afresh but not counted in `levels`. Needs root, for the cgroup.
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from capped import CAP, drop, run_capped
from saved import save
from stores import ORDERS, made

import bfrt
from bfrt.budget import Capacities, capacities
from bfrt.scene import Scene
from bfrt.store.store import open_store

#: The grid of the paper's table 2: 128 voxels an axis, in upper voxels of so many a side.
SIDE = 128
LOWERS = (1, 2, 4)


Rows = list[dict[str, Any]]


class Line(NamedTuple):
    """Points of a plot, and how they are drawn."""

    label: str
    style: str
    objects: list[int]
    seconds: list[float]


#: What the child process is told: the store, the file for its counters, and settings as JSON.
CHILD = "--render"


def render_here(store: str, stats: str, settings: str) -> None:
    """In the child: render with these settings, of which `lower` is none that users have."""
    given = json.loads(settings)
    lower = given.pop("lower", None)

    def limited(*asked: Any) -> Capacities:
        found = capacities(*asked)
        single = (SIDE // lower) ** 3
        return replace(found, limits=found.limits._replace(single=single))

    scene = Scene(open_store(store), capacities if lower is None else limited)
    image = scene.render(memory=CAP, **given)
    Path(stats).write_text(json.dumps(image.stats.as_dict()))
    image.save(str(Path(stats).with_suffix(".npy")))


def rendered(store: Path, folder: Path, **settings: Any) -> dict[str, Any]:
    """The counters of one render, cold and capped."""
    drop(store)
    stats = folder / "stats.json"
    status, _ = run_capped([__file__, CHILD, str(store), str(stats), json.dumps(settings)], CAP)
    if status:
        raise SystemExit(f"{store.name} {settings}: exit status {status}")
    found: dict[str, Any] = json.loads(stats.read_text())
    found["picture"] = (folder / "stats.npy").read_bytes()
    return found


def levels(scene: str, sizes: list[int], runs: int) -> Rows:
    """The time without preprocess of a grid of one level, over that of two."""
    rows = []
    for size in sizes:
        with tempfile.TemporaryDirectory() as name:
            store = made(scene, size, Path(name))
            seconds: dict[int, list[float]] = {lower: [] for lower in LOWERS}
            pictures = set()
            rendered(store, Path(name), lower=1, max_grid=SIDE)  # makes the marks
            for _ in range(runs):
                for lower in LOWERS:
                    found = rendered(store, Path(name), lower=lower, max_grid=SIDE)
                    grid = found["grids"][0]
                    if grid["lower"] != lower or not found["marks_reused"]:
                        raise SystemExit(f"{store.name}: found {grid}, expected lower {lower}")
                    seconds[lower].append(found["seconds"])
                    pictures.add(found["picture"])
        if len(pictures) != 1:
            raise SystemExit(f"{scene} {size}: the pictures differ")
        one, two, four = (float(np.median(seconds[lower])) for lower in LOWERS)
        print(
            f"{scene:7} {size:5} {one:8.2f} {two:8.2f} {four:8.2f} {one / two:6.2f} "
            f"{one / four:6.2f}",
            flush=True,
        )
        for lower, each in zip(LOWERS, (one, two, four), strict=True):
            rows.append({"scene": scene, "size": size, "lower": lower, "seconds": each})
    return rows


def growth(scene: str, sizes: list[int], runs: int) -> Rows:
    """Seconds against objects, marks included: free, and limited."""
    rows = []
    for size in sizes:
        with tempfile.TemporaryDirectory() as name:
            store = made(scene, size, Path(name))
            objects = bfrt.open(store).objects
            medians = []
            for settings in ({}, {"lower": 1, "max_grid": SIDE}):
                found = [
                    rendered(store, Path(name), fresh_marks=True, **settings)["seconds"]
                    for _ in range(runs)
                ]
                medians.append(float(np.median(found)))
        print(f"{scene:7} {size:5} {objects:12,} {medians[0]:8.2f} {medians[1]:8.2f}", flush=True)
        for grid, median in zip(("free", str(SIDE)), medians, strict=True):
            row = {"scene": scene, "size": size, "objects": objects, "grid": grid}
            rows.append({**row, "seconds": median})
    return rows


def tracing(scene: str, sizes: list[int], runs: int) -> Rows:
    """Seconds of tracing against objects, marks there."""
    rows = []
    for size in sizes:
        with tempfile.TemporaryDirectory() as name:
            store = made(scene, size, Path(name))
            objects = bfrt.open(store).objects
            rendered(store, Path(name))  # makes the marks
            found = [rendered(store, Path(name))["seconds"] for _ in range(runs)]
            seconds = float(np.median(found))
        rows.append({"scene": scene, "size": size, "objects": objects, "seconds": seconds})
        print(f"{scene:7} {size:5} {objects:14,} {seconds:8.2f}", flush=True)
    return rows


def lines_of(rows: Rows) -> list[Line]:
    """What `growth` or `tracing` has measured, as lines: each scene's, dashed where the grid is
    limited, and what seconds grow like."""
    lines: dict[tuple[str, str], Line] = {}
    for row in rows:
        grid = row.get("grid", "")
        label, style = (row["scene"], "-o") if grid != str(SIDE) else ("", "--")
        line = lines.setdefault((row["scene"], grid), Line(label, style, [], []))
        line.objects.append(row["objects"])
        line.seconds.append(row["seconds"])
    if len(rows) > 1 and "grid" not in rows[0]:
        objects, seconds = ([row[name] for row in rows] for name in ("objects", "seconds"))
        fit = np.polyfit(np.log(objects), np.log(seconds), 1)
        said = f"objects to the power of {fit[0]:.2f}"
        print(f"seconds grow like {said}")
        through = np.exp(np.polyval(fit, np.log(objects))).tolist()
        return [*lines.values(), Line(said, "-", objects, through)]
    return [*lines.values()]


def draw(lines: list[Line], path: Path) -> None:
    """Seconds against objects, both logarithmic. A line without a label has the color of the one
    before."""
    import matplotlib

    matplotlib.use("agg")
    from matplotlib import pyplot

    figure, axis = pyplot.subplots(figsize=(6.5, 4.5))
    color = None
    for line in lines:
        same = {"color": color} if not line.label and color else {}
        drawn = axis.loglog(
            line.objects, line.seconds, line.style, label=line.label or None, linewidth=0.9, **same
        )
        color = drawn[0].get_color()
    axis.set(xlabel="objects", ylabel="seconds")
    axis.legend()
    figure.tight_layout()
    figure.savefig(path)


def stadium(size: int, runs: int) -> Rows:
    """A teapot in a hall 200 times its size, 128 x 128 pixels: in one group and in two by the
    grid, in one by the tree."""
    scene = bfrt.spd.teapot(size)
    steps = np.arange(-600.0, 601.0, 10.0)
    corners = np.stack(np.meshgrid(steps, steps, [-20.0]), axis=-1).reshape(-1, 1, 3)
    seats = (corners + np.array([[0, 0, 0], [6, 0, 0], [0, 6, 1]])).astype(np.float32)
    rows = []
    with tempfile.TemporaryDirectory() as name:
        for groups, refine in ((1, "sgb"), (2, "sgb"), (1, "tree")):
            store = Path(name) / f"{groups}.{refine}.bfrt"
            layout = {"dtype": np.float32, "origin": (0, 0, 0), "order": ORDERS[refine]}
            with bfrt.SceneWriter(store, **layout) as writer:
                scene.feed(writer)
                writer.camera(replace(scene.camera, resolution=(128, 128)))
                writer.triangles(seats, np.zeros(len(seats), np.uint32), group=groups - 1)
            settings = {"refine": refine} if refine == "tree" else {"fresh_marks": True}
            found = [rendered(store, Path(name), **settings) for _ in range(runs)]
            seconds = float(np.median([f["seconds"] for f in found]))
            print(
                f"{refine}, {groups} groups: {scene.objects + len(seats):,} objects, "
                f"{seconds:.2f} s, "
                f"{found[0]['box_tests'] / 1e6:,.1f} million box tests",
                flush=True,
            )
            row = {"size": size, "refine": refine, "groups": groups, "seconds": seconds}
            row["objects"] = scene.objects + len(seats)
            rows.append({**row, "box_tests": found[0]["box_tests"]})
    return rows


def main() -> None:
    if sys.argv[1:2] == [CHILD]:
        render_here(*sys.argv[2:])
        return
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("what", choices=("levels", "growth", "tracing", "stadium"))
    parser.add_argument("--scenes", nargs="*", default=["rings:36"], help="as rings:36,94")
    parser.add_argument("--size", type=int, default=60, help="of the teapot")
    parser.add_argument("--runs", type=int, default=1)
    parser.add_argument("--plot", type=Path, help="of growth or tracing: a picture to draw")
    parser.add_argument("--json", type=Path)
    parser.add_argument("--folder", type=Path, help="where stores are made")
    arguments = parser.parse_args()
    if arguments.folder:
        tempfile.tempdir = str(arguments.folder)
    if arguments.what == "stadium":
        save(arguments.json, stadium(arguments.size, arguments.runs))
        return
    work = {"levels": levels, "growth": growth, "tracing": tracing}[arguments.what]
    rows: Rows = []
    for wanted in arguments.scenes:
        scene, _, sizes = wanted.partition(":")
        rows += work(scene, [int(size) for size in sizes.split(",")], arguments.runs)
        save(arguments.json, rows)
    if arguments.plot:
        draw(lines_of(rows), arguments.plot)


if __name__ == "__main__":
    main()
