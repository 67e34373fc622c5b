"""Ordering stays inside a bound of memory, whatever the objects are and however many."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

import bfrt

#: Makes objects in blocks, orders them, and prints the most memory that the process had, in MiB.
ORDERED = """
import sys
import numpy as np
from bfrt.store.writer import StoreWriter
from bfrt.store.store import open_store
path, shape, n = sys.argv[1], sys.argv[2], int(sys.argv[3])
rng = np.random.default_rng(0)
block = 1 << 10 if shape == "large polygons" else 1 << 14
with StoreWriter(path, order="spatial", durable=False) as writer:
    for first in range(0, n, block):
        k = min(block, n - first)
        c = rng.random((k, 3), np.float32)
        if shape == "one point":
            c[:] = 0.25
        if shape == "one far" and first == 0:
            c[0] = 1e30
        if shape == "twice":
            c = np.random.default_rng(first % (n // 2)).random((k, 3), np.float32)
        if shape == "large polygons":
            counts = np.where(rng.random(k) < 0.02, 20_000, 4)
            turn = np.concatenate([np.arange(m) * (2 * np.pi / m) for m in counts])
            ring = np.stack([np.cos(turn), np.sin(turn), np.zeros(len(turn))], 1) * 1e-3
            writer.polygons((np.repeat(c, counts, 0) + ring).astype(np.float32), counts)
            continue
        if shape == "polygons":
            counts = np.maximum(4, (4.0 / (1 - rng.random(k)) ** 0.9).astype(int)).clip(max=4000)
            turn = np.concatenate([np.arange(m) * (2 * np.pi / m) for m in counts])
            ring = np.stack([np.cos(turn), np.sin(turn), np.zeros(len(turn))], 1) * 1e-3
            writer.polygons((np.repeat(c, counts, 0) + ring).astype(np.float32), counts)
        else:
            writer.spheres(c, np.float32(1e-3))
if n <= 1 << 20:
    (stream,) = open_store(path).streams
    ids = np.fromfile(stream.path("ids"), np.uint32)
    assert (np.bincount(ids, minlength=n) == 1).all() and len(ids) == n
status = open("/proc/self/status").read()
print(int(status.split("VmHWM:")[1].split()[0]) // 1024)
"""


#: Makes float64 patches as given and in order; prints the plan's memory and the peak, in MiB.
PLANNED = """
import sys
import numpy as np
from bfrt.ordering_planning import ordering_of
from bfrt.store.writer import StoreWriter
from bfrt.store.store import open_store
path, shape, n = sys.argv[1], sys.argv[2], int(sys.argv[3])
for order in ("given", "spatial"):
    rng = np.random.default_rng(0)
    with StoreWriter(path + order, order=order, durable=False) as writer:
        for first in range(0, n, 1 << 14):
            k = min(1 << 14, n - first)
            if shape == "patches":
                corners = rng.random((k, 1, 3)) + rng.normal(0, 1e-3, (k, 3, 3))
                writer.patches(corners, corners)
            else:
                writer.spheres(rng.random((k, 3), np.float32), np.float32(1e-3))
print(ordering_of(open_store(path + "given")).memory // 2**20)
status = open("/proc/self/status").read()
print(int(status.split("VmHWM:")[1].split()[0]) // 1024)
"""


def told_by(code, path, shape, n):
    """Return the numbers that a process prints."""
    source = str(Path(bfrt.__file__).parents[1])
    ended = subprocess.run(
        [sys.executable, "-c", code, str(path), shape, str(n)],
        env={**os.environ, "PYTHONPATH": source, "MALLOC_ARENA_MAX": "2"},
        cwd=Path(path.anchor),
        capture_output=True,
        text=True,
    )
    assert ended.returncode == 0, ended.stderr
    return [int(line) for line in ended.stdout.split()]


def peak_of(path, shape, n):
    (peak,) = told_by(ORDERED, path, shape, n)
    return peak


pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="Linux tells the peak")


@pytest.mark.parametrize("shape", ["one point", "one far", "twice", "polygons"])
def test_awkward_objects(tmp_path, shape):
    assert peak_of(tmp_path / "a.bfrt", shape, 300_000) <= 256


def test_large_polygons(tmp_path):
    """10,000 polygons, of which 200 have all the vertices: 48 MB of them."""
    assert peak_of(tmp_path / "a.bfrt", "large polygons", 10_000) <= 256


@pytest.mark.parametrize(("shape", "n"), [("spheres", 600_000), ("patches", 400_000)])
def test_a_plan_tells_the_memory(tmp_path, shape, n):
    planned, peak = told_by(PLANNED, tmp_path / "a.bfrt", shape, n)
    assert peak <= planned <= 2 * peak


@pytest.mark.slow
@pytest.mark.parametrize("shape", ["random", "one far", "twice"])
def test_four_million_spheres(tmp_path, shape):
    assert peak_of(tmp_path / "a.bfrt", shape, 4_000_000) <= 256
