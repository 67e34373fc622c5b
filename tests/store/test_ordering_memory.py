"""Ordering stays inside a bound of memory, whatever the objects are and however many."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

import bfrt
from bfrt.errors import BudgetError
from bfrt.records import Kind
from bfrt.store.writer import StoreWriter

#: Makes objects in blocks, orders them, and prints the most memory that the process had, in MiB.
ORDERED = """
import sys
import numpy as np
from bfrt.store.writer import StoreWriter
from bfrt.store.store import open_store
path, shape, n = sys.argv[1], sys.argv[2], int(sys.argv[3])
rng = np.random.default_rng(0)
def turns(counts):
    at = np.arange(counts.sum()) - np.repeat(np.cumsum(counts) - counts, counts)
    return at * np.repeat(2 * np.pi / counts, counts)
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
            turn = turns(counts)
            ring = np.stack([np.cos(turn), np.sin(turn), np.zeros(len(turn))], 1) * 1e-3
            writer.polygons((np.repeat(c, counts, 0) + ring).astype(np.float32), counts)
            continue
        if shape == "polygons":
            counts = np.maximum(4, (4.0 / (1 - rng.random(k)) ** 0.9).astype(int)).clip(max=4000)
            turn = turns(counts)
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


#: Makes float64 patches as given and in order; prints the plan's memory and the peak, in MiB. What
#: is made ahead is there before the next window is written: how much that is tells no clock.
PLANNED = """
import concurrent.futures, os, sys, weakref
import numpy as np
from bfrt import workers
from bfrt.planning.ordering import ordering_of
from bfrt.store.ordering import order as ordering
from bfrt.store.writer import StoreWriter
from bfrt.store.store import open_store
path, shape, n = sys.argv[1], sys.argv[2], int(sys.argv[3])
os.sched_setaffinity(0, sorted(os.sched_getaffinity(0))[:2])
begun, ordered = weakref.WeakSet(), ordering.ordered
class Pool(workers.Pool):
    def submit(self, *call):
        future = super().submit(*call)
        begun.add(future)
        return future
def all_made(*given):
    for window in ordered(*given):
        concurrent.futures.wait(list(begun))
        yield window
        del window
workers.Pool, ordering.ordered = Pool, all_made
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


#: Makes objects within a budget, with so many threads; prints the most memory that the process had,
#: in KiB, and a sum of the store's files, or else what was refused.
BUDGETED = """
import sys, zlib
from pathlib import Path
import numpy as np
from bfrt.errors import BudgetError
from bfrt.store import written
from bfrt.store.writer import StoreWriter
path, shape, n, memory, threads, order = *sys.argv[1:3], *map(int, sys.argv[3:6]), sys.argv[6]
written.usable_threads = lambda: threads
rng = np.random.default_rng(0)
def turns(counts):
    at = np.arange(counts.sum()) - np.repeat(np.cumsum(counts) - counts, counts)
    return at * np.repeat(2 * np.pi / counts, counts)
def rings(centers, counts):
    turn = turns(counts)
    ring = np.stack([np.cos(turn), np.sin(turn), np.zeros(len(turn))], 1) * 1e-3
    return np.repeat(centers, counts, 0) + ring, counts
try:
    with StoreWriter(path, order="spatial", durable=False, memory=memory) as writer:
        for first in range(0, n, 1 << 13):
            k = min(1 << 13, n - first)
            c = rng.random((k, 1, 3))
            if order == "local":
                c[..., 0] = (c[..., 0] + first / 8192) * 8192 / n
            if shape == "spheres":
                writer.spheres(c[:, 0].astype(np.float32), np.float32(1e-3))
            elif shape == "polygons":
                counts = (4 / (1 - rng.random(k)) ** 0.6).astype(int).clip(max=400)
                writer.polygons(*rings(c[:, 0], counts))
            elif shape == "one large polygon":
                writer.polygons(*rings(c[:, 0], np.where(np.arange(k) == 9, 700_000, 4)))
            elif shape == "triangles":
                writer.triangles((c + rng.normal(0, 1e-3, (k, 3, 3))).astype(np.float32))
            else:
                corners = c + rng.normal(0, 1e-3, (k, 3, 3))
                writer.patches(corners, corners)
except BudgetError as error:
    print(error)
    print([each.name for each in Path(path).parent.iterdir()])
else:
    files = sorted(each for each in Path(path).glob("*/*/*"))
    status = open("/proc/self/status").read()
    print(status.split("VmHWM:")[1].split()[0])
    print([(each.name, zlib.crc32(each.read_bytes())) for each in files])
"""


def said_by(code, path, *asked):
    """Return the lines that a process prints."""
    source = str(Path(bfrt.__file__).parents[1])
    ended = subprocess.run(
        [sys.executable, "-c", code, str(path), *map(str, asked)],
        env={**os.environ, "PYTHONPATH": source, "MALLOC_ARENA_MAX": "2"},
        cwd=Path(path.anchor),
        capture_output=True,
        text=True,
    )
    assert ended.returncode == 0, ended.stderr
    return ended.stdout.splitlines()


def told_by(code, path, shape, n):
    """Return the numbers that a process prints."""
    return [int(line) for line in said_by(code, path, shape, n)]


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


@pytest.mark.parametrize(("shape", "n"), [("spheres", 1_200_000), ("patches", 800_000)])
def test_a_plan_tells_the_memory(tmp_path, shape, n):
    planned, peak = told_by(PLANNED, tmp_path / "a.bfrt", shape, n)
    assert peak <= planned <= 2 * peak


@pytest.mark.slow
@pytest.mark.parametrize("shape", ["random", "one far", "twice"])
def test_four_million_spheres(tmp_path, shape):
    assert peak_of(tmp_path / "a.bfrt", shape, 4_000_000) <= 256


def test_what_is_announced_is_refused_before_any_work(tmp_path, monkeypatch):
    """A standard scene too, which is written within the default budget."""
    with (
        pytest.raises(BudgetError, match=r"found 98MiB, expected 1\d\dMiB or more to bring"),
        StoreWriter(tmp_path / "a.bfrt", memory="98MiB") as writer,
    ):
        writer.expect({Kind.CONE: 10**7, Kind.SPHERE: 5}, 1.0)
    with StoreWriter(tmp_path / "b.bfrt", memory="98MiB", order="given") as writer:
        writer.expect({Kind.SPHERE: 1}, 1.0)
        writer.spheres([[0.0, 0.0, 0.0]], 1.0)
    monkeypatch.setattr("bfrt.store.writer.default_memory", lambda: 98 << 20)
    scene = bfrt.spd.tetra(10)
    monkeypatch.setattr(type(scene), "feed", None)  # it is not begun
    with pytest.raises(BudgetError, match=r"found 98MiB, expected 10\dMiB or more to bring"):
        scene.write(tmp_path / "c.bfrt", order="spatial")
    assert [each.name for each in tmp_path.iterdir()] == ["b.bfrt"]


LEAST = re.compile(
    r"memory: found (\d+)MiB, expected (\d+)MiB or more to bring the objects of .*a\.bfrt into "
    r"spatial order \(--order given, order='given', takes less\)"
)


@pytest.mark.parametrize("order", [pytest.param("local", marks=pytest.mark.slow), "random"])
@pytest.mark.parametrize(
    ("shape", "n"),
    [
        ("spheres", 500_000),
        ("triangles", 400_000),
        pytest.param("patches", 400_000, marks=pytest.mark.slow),
        pytest.param("polygons", 200_000, marks=pytest.mark.slow),
        ("one large polygon", 8_000),
    ],
)
def test_the_budget_is_kept_from_the_least_up(tmp_path, shape, n, order):
    """By one thread and by more; the store is the same, and below the least there is none."""
    path = tmp_path / "a.bfrt"
    said, left = said_by(BUDGETED, path, shape, n, 1 << 20, 2, order)
    least = int(LEAST.fullmatch(said)[2])
    assert left == "[]"
    said, left = said_by(BUDGETED, path, shape, n, (least - 1) << 20, 2, order)
    assert LEAST.fullmatch(said).groups() == (str(least - 1), str(least))
    assert left == "[]"
    stores = set()
    for budget, threads in ((least, 1), (least, 3), (least + 30, 3), (least + 100, 3), (2048, 4)):
        peak, store = said_by(BUDGETED, path, shape, n, budget << 20, threads, order)
        assert int(peak) <= budget << 10, (shape, budget, threads)
        stores.add(store)
    assert len(stores) == 1
