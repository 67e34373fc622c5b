"""One case of the suite, in a process of its own: what it does is told by JSON, so are its facts.

::

    python bench/case.py render '{"store": "rings.bfrt", "memory": 268435456}' facts.json

The facts have a number that proves the answer: a digest of a picture's channels or of the answers,
and counts of rays.
"""

from __future__ import annotations

import json
import sys
import tempfile
import time
import zlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

import bfrt

Facts = dict[str, Any]


def digest(arrays: dict[str, np.ndarray]) -> str:
    """A checksum of named arrays, bit for bit."""
    total = 0
    for name in sorted(arrays):
        total = zlib.crc32(name.encode(), total)
        total = zlib.crc32(np.ascontiguousarray(arrays[name]).view(np.uint8).reshape(-1), total)
    return f"{total:08x}"


def counted(stats: Any) -> Facts:
    """What the counters say, in few words."""
    found = stats.as_dict()
    phases = found["phases"]
    return {
        "phases": {name: round(phase["seconds"], 4) for name, phase in phases.items()},
        "bytes_read": sum(phase["bytes_read"] for phase in phases.values()),
        "seeks": sum(phase["seeks"] for phase in phases.values()),
        "passes": found["passes"],
        "sweeps": sum(depth["passes"] for depth in found["depths"]),
        "seconds": found["seconds"],
        "rays": found["rays"],
        "box_tests": found["box_tests"],
        "marks_reused": found["marks_reused"],
    }


def camera_of(view: str) -> bfrt.Camera | None:
    """A standard view by its name; the scene's own without one."""
    return bfrt.spd.VIEWS[view] if view else None


def render(store: str, view: str = "", picture: str = "", **settings: Any) -> Facts:
    image = bfrt.render(store, camera=camera_of(view), **settings)
    if picture:
        image.save(picture)
    return {"digest": digest(image.channels), **counted(image.stats)}


def cast(store: str, rays: int, query: str, **settings: Any) -> Facts:
    """Random rays between points of the scene's bounds, from files and to files: arrays of the
    caller's would be beside the budget."""
    scene = bfrt.open(store)
    random = np.random.default_rng(1)
    lo, hi = scene.bounds.lo, scene.bounds.hi
    with tempfile.TemporaryDirectory(dir=Path(store).parent) as name:
        given = [Path(name, "origins.npy"), Path(name, "directions.npy")]
        for path in given:
            file = np.lib.format.open_memmap(path, "w+", np.float64, (rays, 3))
            for first in range(0, rays, 1 << 16):
                block = random.uniform(lo, hi, (min(1 << 16, rays - first), 3))
                file[first : first + len(block)] = block
        ends = np.load(given[1], mmap_mode="r+")
        ends -= np.load(given[0], mmap_mode="r")
        answer = getattr(scene, query)(*given, out=Path(name, "answer"), **settings)
        return {"digest": digest(dict(answer)), **counted(answer.stats)}


def convert(source: str, target: str, **settings: Any) -> Facts:
    scene = bfrt.convert(source, target, **settings)
    return {"digest": f"{scene.store.checksum:08x}", "objects": scene.objects, "bytes": scene.bytes}


def spd(name: str, size: int, target: str, **options: str) -> Facts:
    scene = bfrt.spd.scene(name, size, **options).write(target)
    return {"digest": f"{scene.store.checksum:08x}", "objects": scene.objects, "bytes": scene.bytes}


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


def sliced(store: str, view: str, sweeps: int, **settings: Any) -> Facts:
    """Seconds of the preprocess, and of a sweep: of the first ones, after which the render is
    cancelled."""
    times: list[float] = []
    start = time.perf_counter()

    def tell(_: object) -> bool:
        times.append(time.perf_counter())
        return len(times) <= sweeps

    try:
        bfrt.render(store, camera=camera_of(view), progress=tell, **settings)
    except bfrt.Cancelled:
        return {"preprocess": times[0] - start, "sweep": (times[-1] - times[0]) / sweeps}
    raise SystemExit(f"{store} {settings}: the render was done before its slice was")


CASES: dict[str, Callable[..., Facts]] = {
    "render": render, "cast": cast, "convert": convert, "spd": spd, "read": read, "sliced": sliced,
}  # fmt: skip

if __name__ == "__main__":
    what, settings, facts = sys.argv[1:]
    Path(facts).write_text(json.dumps(CASES[what](**json.loads(settings))))
