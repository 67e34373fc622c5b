"""The tree beside the grid: pictures of standard scenes, of objects in random order, and rays.

::

    python bench/tree.py scenes balls:8 mount:12 --runs 3      sgb, store as given; tree, spatial
    python bench/tree.py huge rings:250                        tracing in reads of the store
    python bench/tree.py random 16000000                       from a file in random order
    python bench/tree.py rays 1000000                          loaded; Open3D beside, where it is
    python bench/tree.py costs 100000                          bytes of an object, by kind

Renders and conversions are cold, in memory cgroups of 256 MiB (root makes them), in turn; medians.
Pictures and rays of both have to be the same.
"""

from __future__ import annotations

import argparse
import json
import shutil
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import stores
from capped import CAP, drop, run_capped
from saved import save

with suppress(ImportError):  # the peer's Python needs none of it
    import bfrt
    from bfrt.records import Kind

#: Those that are compared, each with the order of its store.
ORDERS = {refine: stores.ORDERS[refine] for refine in ("sgb", "tree")}


def capped(arguments: list[str]) -> float:
    """The seconds of a command in a cgroup."""
    start = time.perf_counter()
    status, peak = run_capped(["-m", "bfrt", *arguments, "--quiet"], CAP)
    if status:
        raise SystemExit(f"bfrt {' '.join(arguments)}: exit status {status}, peak {peak}")
    return time.perf_counter() - start


def rendered(store: Path, refine: str, folder: Path) -> dict[str, Any]:
    """The counters of one render, cold and capped."""
    drop(store)
    stats = folder / f"{refine}.json"
    fresh = [] if refine == "tree" else ["--fresh-marks"]
    picture = str(folder / f"{refine}.npy")
    seconds = capped([
        "render", str(store), "-o", picture, "--memory", "256MiB", "--refine", refine,
        "--stats", str(stats), *fresh,
    ])  # fmt: skip
    found = json.loads(stats.read_text())
    phases = found["phases"]
    tracing = {name: p for name, p in phases.items() if name != "preprocess"}
    return {
        "seconds": seconds,
        "preprocess": phases["preprocess"]["seconds"],
        "tracing": sum(p["seconds"] for p in tracing.values()),
        "bytes": sum(p["bytes_read"] for p in tracing.values()),
        "phases": {name: p["seconds"] for name, p in phases.items()},
        "passes": found["passes"],
        "rays": found["rays"],
        "tree": found["tree"],
    }


def middle(runs: list[dict[str, Any]]) -> dict[str, Any]:
    """The run of median seconds."""
    return sorted(runs, key=lambda run: run["seconds"])[len(runs) // 2]


def alike(folder: Path, *found: dict[str, Any]) -> None:
    """Refuse pictures or rays that differ."""
    if len({(folder / f"{refine}.npy").read_bytes() for refine in ORDERS}) != 1:
        raise SystemExit("the pictures differ")
    if len({json.dumps(each["rays"]) for each in found}) != 1:
        raise SystemExit("the rays differ")


def scenes(options: argparse.Namespace, folder: Path) -> list[dict[str, Any]]:
    """Standard scenes by sgb and by the tree."""
    rows = []
    for scene in options.what:
        name, size = scene.split(":")
        made, making = {}, {}
        for refine, order in ORDERS.items():
            made[refine] = folder / f"{name}{size}.{order}"
            command = ["spd", name, size, "-o", str(made[refine]), "--order", order]
            command += ["--memory", "256MiB"]
            making[refine] = capped(command)
        runs: dict[str, list[dict[str, Any]]] = {refine: [] for refine in ORDERS}
        for _ in range(options.runs):
            for refine, store in made.items():
                runs[refine].append(rendered(store, refine, folder))
            alike(folder, *(each[-1] for each in runs.values()))
        sgb, tree = (middle(runs[refine]) for refine in ORDERS)
        row = {"scene": scene, "making": making, "sgb": sgb, "tree": tree}
        row["bytes"] = {refine: bfrt.open(store).bytes for refine, store in made.items()}
        rows.append(row)
        print(
            f"{scene:12} tracing {sgb['tracing']:7.2f} {tree['tracing']:7.2f} s: "
            f"{sgb['tracing'] / tree['tracing']:5.2f}   preprocess {sgb['preprocess']:6.2f} s   "
            f"passes {sgb['passes']:3} {tree['passes']:3}   read {sgb['bytes'] / 1e9:6.2f} "
            f"{tree['bytes'] / 1e9:6.2f} GB   store {row['bytes']['sgb'] / 1e9:5.2f} "
            f"{row['bytes']['tree'] / 1e9:5.2f} GB   made in {making['sgb']:6.2f} "
            f"{making['tree']:6.2f} s   {tree['phases']}",
            flush=True,
        )
        for store in made.values():
            shutil.rmtree(store)
    return rows


def spheres(count: int, path: Path) -> None:
    """Spheres at random in a cube, as NumPy's rows x y z r."""
    rows = np.lib.format.open_memmap(path, "w+", np.float32, (count, 4))
    random = np.random.default_rng(1)
    for first in range(0, count, 1 << 20):
        block = rows[first : first + (1 << 20)]
        block[:, :3] = random.random((len(block), 3), np.float32)
        block[:, 3] = 0.3 * count ** (-1 / 3)
    rows.flush()


def at_random(options: argparse.Namespace, folder: Path) -> list[dict[str, Any]]:
    """From a file of spheres in random order to a picture."""
    rows = []
    for count in map(int, options.what):
        file = folder / "spheres.npy"
        spheres(count, file)
        runs: dict[str, list[dict[str, Any]]] = {refine: [] for refine in ORDERS}
        for _ in range(options.runs):
            for refine, order in ORDERS.items():
                drop(file)
                store = folder / order
                command = ["convert", str(file), "-o", str(store), "--order", order]
                making = capped([*command, "--memory", "256MiB"])
                found = rendered(store, refine, folder)
                runs[refine].append({**found, "making": making, "picture": found["seconds"]})
                runs[refine][-1]["seconds"] += making
                shutil.rmtree(store)
            alike(folder, *(each[-1] for each in runs.values()))
        sgb, tree = (middle(runs[refine]) for refine in ORDERS)
        rows.append({"spheres": count, "sgb": sgb, "tree": tree})
        print(
            f"{count:11,} spheres: sgb {sgb['seconds']:6.2f} s ({sgb['making']:.2f} + "
            f"{sgb['picture']:.2f}), tree {tree['seconds']:6.2f} s ({tree['making']:.2f} + "
            f"{tree['picture']:.2f}): {sgb['seconds'] / tree['seconds']:.2f}   {tree['phases']}",
            flush=True,
        )
    return rows


def huge(options: argparse.Namespace, folder: Path) -> list[dict[str, Any]]:
    """Scenes that are larger than memory many times, in sequential reads of the store."""
    rows = []
    for scene in options.what:
        name, size = scene.split(":")
        store = folder / f"{name}{size}"
        order = stores.ORDERS["tree"]
        command = ["spd", name, size, "-o", str(store), "--order", order]
        making = capped([*command, "--memory", "256MiB"])
        drop(store)
        start = time.perf_counter()
        files = [str(file) for file in store.rglob("*") if file.is_file()]
        subprocess.run(["cat", *files], stdout=subprocess.DEVNULL, check=True)
        read = time.perf_counter() - start
        found = middle([rendered(store, "tree", folder) for _ in range(options.runs)])
        objects, size = bfrt.open(store).objects, bfrt.open(store).bytes
        rows.append({"scene": scene, "making": making, "read": read, "bytes": size, **found})
        print(
            f"{scene:12} {objects:,} objects, {size / 1e9:.1f} GB, made in {making:.1f} s, read in "
            f"{read:.1f} s: tracing {found['tracing']:.1f} s, {found['tracing'] / read:.2f} reads, "
            f"{found['bytes'] / 1e9:.1f} GB in {found['passes']} passes   {found['phases']}",
            flush=True,
        )
        shutil.rmtree(store)
    return rows


Corners = tuple[Any, Any]


def terrain(count: int) -> Corners:
    """About so many triangles of a bumpy square: vertices, and faces."""
    side = round((count / 2) ** 0.5)
    x, y = np.meshgrid(*[np.linspace(-1, 1, side + 1)] * 2, indexing="ij")
    z = 0.1 * np.sin(7 * x) * np.cos(9 * y) + 0.02 * np.sin(40 * x + 3 * y) * np.sin(37 * y)
    z += 0.004 * np.sin(200 * x) * np.cos(190 * y)
    vertices = np.stack([x, y, z], -1).reshape(-1, 3).astype(np.float32)
    i = (np.arange(side)[:, None] * (side + 1) + np.arange(side)).reshape(-1)
    one, other = [i, i + side + 1, i + 1], [i + 1, i + side + 1, i + side + 2]
    return vertices, np.concatenate([np.stack(one, 1), np.stack(other, 1)]).astype(np.uint32)


def of_kinds(count: int) -> dict[str, Corners]:
    """Rays, coherent and not: origins and directions."""
    random = np.random.default_rng(1)
    side = round(count**0.5)
    u, v = np.meshgrid(*[np.linspace(-0.9, 0.9, side)] * 2)
    ends = np.stack([u, v, np.zeros_like(u)], -1).reshape(-1, 3)
    eye = np.broadcast_to([0.0, 0.0, 2.0], ends.shape)
    origins = random.uniform(-1, 1, ends.shape) * [1, 1, 0.3] + [0, 0, 0.43]
    ways = random.normal(size=ends.shape)
    ways[:, 2] = -abs(ways[:, 2])
    rays = {"coherent": (eye, ends - eye), "incoherent": (origins, ways)}
    return {kind: (o.astype(np.float32), d.astype(np.float32)) for kind, (o, d) in rays.items()}


def rate_of(count: int, ask: Callable[[], object]) -> float:
    """Rays a second, by the median of five."""
    seconds = []
    for _ in range(6):  # the first reads what stays
        start = time.perf_counter()
        ask()
        seconds.append(time.perf_counter() - start)
    return count / statistics.median(seconds[1:])


PEER = """
import sys
import numpy as np, open3d as o3d
sys.path.insert(0, sys.argv[1])
from tree import of_kinds, rate_of, terrain
vertices, faces = terrain(int(sys.argv[2]))
scene = o3d.t.geometry.RaycastingScene(nthreads=2)
scene.add_triangles(vertices, faces)
for kind, rays in of_kinds(1_000_000).items():
    tensor = o3d.core.Tensor(np.concatenate(rays, 1))
    print(kind, rate_of(1_000_000, lambda: scene.cast_rays(tensor, nthreads=2)))
"""


def loaded(options: argparse.Namespace, folder: Path) -> list[dict[str, Any]]:
    """A million rays on a scene in memory, by two threads."""
    rows = []
    for count in map(int, options.what):
        vertices, faces = terrain(count)
        with bfrt.SceneWriter(folder / "terrain", order="spatial") as writer:
            writer.triangles(vertices[faces])
        del vertices, faces
        found: dict[str, Any] = {}
        with bfrt.open(folder / "terrain") as scene:
            for kind, rays in of_kinds(1_000_000).items():
                for refine in ORDERS:
                    given = {"refine": refine, "memory": "8GiB", "threads": 2}
                    ask = partial(scene.cast_rays, *rays, **given)
                    found[f"{refine} {kind}"] = rate_of(1_000_000, ask)
        if options.peer:
            command = [options.peer, "-c", PEER, str(Path(__file__).parent), str(count)]
            for line in subprocess.run(command, capture_output=True, text=True).stdout.splitlines():
                kind, rate = line.split()
                found[f"open3d {kind}"] = float(rate)
        rows.append({"triangles": count, "rays a second": found})
        print(count, {name: f"{rate / 1e6:.2f} M/s" for name, rate in found.items()}, flush=True)
        shutil.rmtree(folder / "terrain")
    return rows


def of_kind(kind: Kind, centers: Any, writer: bfrt.SceneWriter) -> None:
    """Add small objects of a kind at some places."""
    size = np.float32(0.3 * len(centers) ** (-1 / 3))
    near = np.random.default_rng(2).normal(0, size, (len(centers), 3, 3)).astype(np.float32)
    corners = centers[:, None] + near
    if kind == Kind.SPHERE:
        writer.spheres(centers, size)
    elif kind == Kind.CONE:
        writer.cones(centers, size, centers + near[:, 0], size / 2)
    elif kind == Kind.TRIANGLE:
        writer.triangles(corners)
    elif kind == Kind.PATCH:
        writer.patches(corners, near)
    else:
        square = size * np.float32([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]])
        vertices = (centers[:, None] + square).reshape(-1, 3)
        writer.polygons(vertices, np.full(len(centers), 4))


def costs(options: argparse.Namespace, folder: Path) -> list[dict[str, Any]]:
    """The bytes of an object in spatial order, by kind; and the most of its ordering."""
    rows = []
    for count in map(int, options.what):
        centers = np.random.default_rng(1).random((count, 3), np.float32)
        for kind in Kind:
            for order in ("given", "spatial"):
                with bfrt.SceneWriter(folder / order, order=order, durable=False) as writer:
                    of_kind(kind, centers, writer)
            given, ordered = (bfrt.open(folder / order) for order in ("given", "spatial"))
            (stream,) = ordered.store.streams
            row = {name: facts.bytes / count for name, facts in stream.files.items()}
            row["levels"] = sum(row.pop(name) for name in [*row] if name.startswith("level"))
            told = given.plan(refine="sgb").ordering
            row = {"kind": kind.label, "objects": count, **row, "ordering": told.disk / count}
            rows.append(row)
            each = "  ".join(f"{key} {value:.2f}" for key, value in [*row.items()][2:])
            print(f"{count:11,} {kind.label:8} {each}", flush=True)
    return rows


WORKS = {"scenes": scenes, "huge": huge, "random": at_random, "rays": loaded, "costs": costs}


def main() -> None:
    """Measure what is asked for."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("work", choices=WORKS)
    parser.add_argument("what", nargs="+", help="SCENE:SIZE, or numbers of objects")
    parser.add_argument("--runs", type=int, default=1)
    parser.add_argument("--folder", type=Path, help="where stores are made")
    parser.add_argument("--peer", help="a Python that has Open3D")
    parser.add_argument("--json", type=Path)
    options = parser.parse_args()
    with tempfile.TemporaryDirectory(dir=options.folder) as folder:
        rows = WORKS[options.work](options, Path(folder))
    save(options.json, rows)


if __name__ == "__main__":
    sys.exit(main())
