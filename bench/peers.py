"""bfrt beside programs that hold their scenes in memory: from a file to an answer, under caps.

::

    python bench/peers.py --millions 1 4 16 64 --caps 256MiB 1GiB 4GiB 18GiB --json peers.json
    python bench/peers.py --steady       rays a second, of a scene that is loaded and fits

A terrain as binary PLY, and a million rays from a camera above it. Each program is a process of
its own inside a memory cgroup, with its files dropped from the page cache before; programs take
turns. Told are seconds, the cgroup's peak, or how it died; answers are compared with bfrt's. Those
that are not installed, here or in a Python that ``--python`` names, are left out, said so.
"""

from __future__ import annotations

import argparse
import functools
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from capped import drop, run_capped
from data import terrain
from peer import PEERS
from saved import save

from bfrt.memory import parse_memory

RAYS = 1024

#: Modules that a program needs beside its own.
NEEDS = {"trimesh": ("embreex",)}
ONE = str(Path(__file__).with_name("peer.py"))


def camera_rays(side: int, seed: int | None = None) -> np.ndarray:
    """Rays from above a corner of the terrain to the middle; with a seed from anywhere above it
    to anywhere on it, in no order."""
    size = float(side)
    if seed is not None:
        random = np.random.default_rng(seed)
        origins = random.uniform(0, size, (RAYS * RAYS, 3)) * (1, 1, 0.1) + (0, 0, 0.3 * size)
        ends = random.uniform(0, size, (RAYS * RAYS, 3)) * (1, 1, 0)
        return np.concatenate([origins, ends - origins], axis=1).astype(np.float32)
    eye = np.array([-0.3, -0.4, 0.6]) * size
    forward = np.array([0.5, 0.5, 0.0]) * size - eye
    forward /= np.linalg.norm(forward)
    right = np.cross(forward, [0, 0, 1.0])
    right /= np.linalg.norm(right)
    up = np.cross(right, forward)
    u, v = np.meshgrid(np.linspace(-0.5, 0.5, RAYS), np.linspace(0.5, -0.5, RAYS))
    ways = forward + u[..., None] * right + v[..., None] * up
    origins = np.broadcast_to(eye, ways.shape)
    return np.concatenate([origins, ways], axis=2).reshape(-1, 6).astype(np.float32)


def save_rays(folder: Path, rays: np.ndarray) -> None:
    folder.mkdir(exist_ok=True)
    np.save(folder / "origins.npy", rays[:, :3])
    np.save(folder / "directions.npy", rays[:, 3:])


@functools.cache
def has(python: str, name: str) -> bool:
    """Whether a Python finds a program's modules."""
    modules = (name, *NEEDS.get(name, ()))
    asked = f"import importlib.util as u, sys; sys.exit(not all(map(u.find_spec, {modules})))"
    return subprocess.run([python, "-c", asked], check=False).returncode == 0


def pythons_of(names: Iterable[str], others: Sequence[str]) -> dict[str, str]:
    """The Python of each program that one has: this one, or the first of the others."""
    found = {}
    for name in names:
        python = next((p for p in (sys.executable, *others) if has(p, name)), None)
        if python is None:
            print(f"{name} is not installed: it is left out", flush=True)
        else:
            found[name] = python
    return found


def how(status: int) -> str:
    """How a process ended."""
    if status in (-9, 137):
        return "killed"
    return f"exit status {status}" if status else ""


def run(program: tuple[str, str], cap: str, ply: Path, rays: Path, hits: Path) -> dict[str, Any]:
    """One run of a program by its Python: seconds, peak and end."""
    name, python = program
    for file in (ply, rays):
        drop(file)
    hits.unlink(missing_ok=True)
    amount = parse_memory(cap)
    command = [ONE, name, str(ply), str(rays), str(hits), "--memory", cap]
    start = time.perf_counter()
    status, peak = run_capped(command, amount, python=python)
    seconds = time.perf_counter() - start
    return {"seconds": seconds, "peak": peak, "end": how(status)}


def compare(own: np.ndarray, other: np.ndarray) -> dict[str, float]:
    """Rays of which one hits and one does not, and the greatest difference of the others' t."""
    hit = np.isfinite(own) & np.isfinite(other)
    apart = np.abs(own[hit] - other[hit]) / own[hit]
    return {
        "hit_and_missed": int((np.isfinite(own) != np.isfinite(other)).sum()),
        "other_t": int((apart > 1e-4).sum()),
    }


def measure(
    millions: float, caps: list[str], runs: int, folder: Path, others: list[str]
) -> list[dict[str, Any]]:
    """A row for each cap and program."""
    programs = pythons_of(PEERS, others)
    side = round((millions * 1e6 / 2) ** 0.5) + 1
    ply, rays = folder / "terrain.ply", folder / "rays"
    terrain(side, ply)
    save_rays(rays, camera_rays(side))
    rows = []
    for cap in caps:
        found: dict[str, list[dict[str, Any]]] = {name: [] for name in programs}
        for _ in range(runs):
            for name, all_runs in found.items():
                program = name, programs[name]
                all_runs.append(run(program, cap, ply, rays, folder / f"{name}.npy"))
        own = np.load(folder / "bfrt.npy")
        for name, all_runs in found.items():
            row = {"millions": millions, "cap": cap, "name": name, "end": all_runs[0]["end"]}
            row["seconds"] = statistics.median(one["seconds"] for one in all_runs)
            row["peak"] = max(one["peak"] for one in all_runs)
            if not row["end"]:
                row.update(compare(own, np.load(folder / f"{name}.npy")))
            rows.append(row)
            print(
                f"{millions:6g} M  {cap:>7}  {name:8} {row['seconds']:8.2f} s "
                f"{row['peak'] >> 20:6} MiB  {row['end'] or row['hit_and_missed']}",
                flush=True,
            )
    return rows


def steady(folder: Path, rounds: int, others: list[str]) -> list[dict[str, Any]]:
    """Rays a second of a terrain of a million triangles."""
    side = 708
    rows = []
    programs = pythons_of(PEERS, others)
    ply = folder / "terrain.ply"
    terrain(side, ply)
    for kind, seed in (("coherent", None), ("incoherent", 1)):
        save_rays(folder / "rays", camera_rays(side, seed))
        for name, python in programs.items():
            command = [
                python, ONE, name, str(ply), str(folder / "rays"),
                str(folder / "hits.npy"), "--rounds", str(rounds), "--memory", "4GiB",
            ]  # fmt: skip
            done = subprocess.run(command, check=name == "bfrt", stdout=subprocess.PIPE, text=True)
            if done.returncode:
                print(f"{name}: {how(done.returncode)}: it is left out", flush=True)
                continue
            seconds = statistics.median(float(line) for line in done.stdout.split()[-rounds:])
            rate = RAYS * RAYS / seconds
            rows.append({"rays": kind, "name": name, "rate": rate})
            print(f"{kind:10} {name:8} {rate / 1e6:8.2f} M rays/s", flush=True)
    return rows


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--millions", type=float, nargs="*", default=[1, 4])
    parser.add_argument("--caps", nargs="*", default=["256MiB", "1GiB", "4GiB"])
    parser.add_argument("--runs", type=int, default=1)
    parser.add_argument("--steady", action="store_true")
    parser.add_argument("--python", nargs="*", default=[], help="others, that have the peers")
    parser.add_argument("--json", type=Path)
    parser.add_argument("--folder", type=Path)
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory(dir=arguments.folder) as name:
        if arguments.steady:
            save(arguments.json, steady(Path(name), arguments.runs, arguments.python))
            return
        rows = []
        for millions in arguments.millions:
            given = arguments.caps, arguments.runs, Path(name), arguments.python
            rows += measure(millions, *given)
            save(arguments.json, rows)


if __name__ == "__main__":
    main()
