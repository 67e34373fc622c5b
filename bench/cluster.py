"""What a cluster costs and what it gains: one worker against a process, and two against one.

::

    python bench/cluster.py --scene rings:94 --pixels 1024 --rays 4000000 --runs 3 --json x.json

Without options it takes two minutes, with about ten seconds of work by `sgb` in each case. Each is
in a memory cgroup of its own, where one can be made, and has one thread. Marks are there. The
process asks about the same blocks of rays, one after another: of fewer and larger ones the objects
stream past less often, on a cluster too. Rays are made where they are asked about, before the clock
starts, so that what travels is what a query itself sends: its tasks, and the answers to the client.
Both are told in bytes a ray.
"""

from __future__ import annotations

import argparse
import dataclasses
import json
import pickle
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from capped import run_capped
from capped_workers import capped_workers
from case import digest
from saved import save
from stores import ORDERS, made

import bfrt

#: The budget of a process, and what its cgroup has: beside the budget are Dask and arrays of rays.
MEMORY = 512 << 20
CAP = 3 << 30

#: Rays of each block that are asked about before the clock starts.
HEAD = 1000

#: What the child process that has no cluster is told.
LOCAL = "--local"

#: Blocks of rays: one for each of two workers.
BLOCKS = 2

Facts = dict[str, Any]


class Work(NamedTuple):
    """What is done: a store, how, a picture of so many pixels a side, and so many rays."""

    store: str
    refine: str
    pixels: int
    rays: int
    runs: int

    @property
    def settings(self) -> dict[str, Any]:
        return {"memory": MEMORY, "threads": 1, "refine": self.refine}

    def camera(self, scene: bfrt.Scene, pixels: int | None = None) -> bfrt.Camera:
        side = pixels or self.pixels
        return dataclasses.replace(scene.camera, resolution=(side, side))


def ray_ends(scene: bfrt.Scene, seed: int, count: int) -> np.ndarray:
    """Random points (count, 3) in the scene's bounds."""
    return np.random.default_rng(seed).uniform(*scene.bounds, (count, 3))


def best(runs: int, work: Callable[[], Any]) -> tuple[float, Any]:
    """The least seconds of several runs, and what the last one gave back."""
    seconds, found = [], None
    for _ in range(runs):
        start = time.perf_counter()
        found = work()
        seconds.append(time.perf_counter() - start)
    return min(seconds), found


def local(work: Work) -> Facts:
    """Render and ask in this process."""
    scene = bfrt.open(work.store)
    scene.render(camera=work.camera(scene, 8), **work.settings)
    seconds, image = best(
        work.runs, lambda: scene.render(camera=work.camera(scene), **work.settings)
    )
    facts = {"render": {"seconds": seconds, "digest": digest(image.channels)}}
    each = work.rays // BLOCKS
    ends = [[ray_ends(scene, 2 * n + k, each) for k in range(2)] for n in range(BLOCKS)]
    blocks = [(origins, targets - origins) for origins, targets in ends]
    scene.cast_rays(*(part[:10] for part in blocks[0]), **work.settings)
    seconds, answers = best(
        work.runs, lambda: [scene.cast_rays(*block, **work.settings) for block in blocks]
    )
    whole = {key: np.concatenate([answer[key] for answer in answers]) for key in answers[0]}
    facts["query"] = {"seconds": seconds, "digest": digest(whole)}
    return facts


def clustered(work: Work, client: Any) -> Facts:
    """Render and ask by the workers of a client."""
    scene = bfrt.open(work.store)
    scene.render(camera=work.camera(scene, work.pixels // 4), client=client, **work.settings)
    sent = outgoing(client)
    seconds, image = best(
        work.runs,
        lambda: scene.render(camera=work.camera(scene), client=client, **work.settings),
    )
    rays = image.stats.total.rays
    rays = rays.eye + rays.reflection + rays.refraction + rays.shadow
    travelled = (outgoing(client) - sent) / work.runs / rays
    facts = {"render": {"seconds": seconds, "digest": digest(image.channels), "bytes": travelled}}
    facts["query"] = asked(work, scene, client)
    return facts


def asked(work: Work, scene: bfrt.Scene, client: Any) -> Facts:
    """Ask by dask arrays, whose blocks the workers have."""
    import dask
    import dask.array as da
    from distributed import wait

    def points(k: int) -> Any:
        each = work.rays // BLOCKS
        make = dask.delayed(ray_ends)
        blocks = [make(scene, 2 * n + k, each) for n in range(BLOCKS)]
        return da.concatenate([da.from_delayed(b, (each, 3), np.float64) for b in blocks])

    origins, targets = points(0), points(1)
    origins, directions = client.persist([origins, targets - origins])
    wait([origins, directions])
    few = [rays.map_blocks(head, chunks=(HEAD, 3)) for rays in (origins, directions)]
    dask.compute(scene.cast_rays(*few, **work.settings))  # by all workers, who open the store
    sent = outgoing(client)

    def ask() -> Any:
        return dask.compute(scene.cast_rays(origins, directions, **work.settings))[0]

    seconds, answer = best(work.runs, ask)
    graph = scene.cast_rays(origins, directions, **work.settings).__dask_graph__()
    tasks = {key: task for key, task in dict(graph).items() if not hasattr(task, "release")}
    return {
        "seconds": seconds,
        "digest": digest(answer),
        "bytes": (outgoing(client) - sent) / work.runs / work.rays,
        "graph": sum(len(pickle.dumps(task)) for task in tasks.values()) / work.rays,
    }


def head(rays: np.ndarray) -> np.ndarray:
    """The first rays of a block."""
    return rays[:HEAD]


def outgoing(client: Any) -> int:
    """The bytes that all workers have sent so far."""
    return sum(client.run(lambda dask_worker: dask_worker.transfer_outgoing_bytes_total).values())


def measured(work: Work, folder: Path) -> dict[str, Facts]:
    """Facts of this process, one worker, and two; the answers of all are the same."""
    facts = folder / "facts.json"
    status, _ = run_capped([__file__, LOCAL, str(facts), json.dumps(work)], CAP)
    if status:
        raise SystemExit(f"{work.store}: exit status {status}")
    found = {"local": json.loads(facts.read_text())}
    for count in (1, 2):
        with capped_workers(count, CAP, folder) as workers:
            found[str(count)] = clustered(work, workers.client)
    for ask in ("render", "query"):
        if len({facts[ask]["digest"] for facts in found.values()}) > 1:
            raise SystemExit(f"{ask}: found other answers by workers than here, expected the same")
    return found


def told(found: dict[str, Facts]) -> str:
    """A line for the picture, and one for the rays."""
    lines = []
    for ask in ("render", "query"):
        here, one, two = (found[who][ask] for who in ("local", "1", "2"))
        lines.append(
            f"{ask:7} local {here['seconds']:7.2f} s, one worker {one['seconds']:7.2f} s "
            f"({one['seconds'] / here['seconds'] - 1:+.1%}), two {two['seconds']:7.2f} s "
            f"({one['seconds'] / two['seconds']:.2f} times), {one['bytes']:.1f} bytes a ray to the "
            f"client, {one.get('graph', 0):.4f} of tasks"
        )
    return "\n".join(lines)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--scene", default="rings:94", help="NAME:SIZE of a standard scene")
    parser.add_argument("--refine", nargs="+", default=["sgb", "tree"], choices=ORDERS)
    parser.add_argument("--pixels", type=int, default=640)
    parser.add_argument("--rays", type=int, default=1_000_000)
    parser.add_argument("--runs", type=int, default=1)
    parser.add_argument("--json", type=Path)
    parser.add_argument("--folder", type=Path, help="where stores are made")
    given = parser.parse_args()
    name, size = given.scene.split(":")
    every = {}
    with tempfile.TemporaryDirectory(dir=given.folder) as folder:
        for refine in given.refine:
            store = made(name, int(size), Path(folder), ORDERS[refine])
            work = Work(str(store), refine, given.pixels, given.rays, given.runs)
            every[refine] = measured(work, Path(folder))
            print(f"{given.scene} {refine}\n{told(every[refine])}", flush=True)
    save(given.json, every)


if __name__ == "__main__":
    if sys.argv[1:2] == [LOCAL]:
        Path(sys.argv[2]).write_text(json.dumps(local(Work(*json.loads(sys.argv[3])))))
    else:
        main()
