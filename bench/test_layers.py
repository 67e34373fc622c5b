"""Each layer by itself, in memory or in the page cache: nanoseconds, not minutes."""

from __future__ import annotations

import io
import subprocess
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import bfrt
from bfrt.formats.nff import read_nff
from bfrt.grid.grid import Grid
from bfrt.phases.hit_order import HitLoads
from bfrt.records import HIT, SCALARS, Kind
from bfrt.reference._kernels import meet, spans
from bfrt.store.columns import prepare
from bfrt.store.hierarchy import Hierarchy, Level
from bfrt.streams.reader import Reader, SharedFile
from bfrt.streams.spool import Spool

READ = 256 << 20
CHUNK = 1 << 18


@pytest.fixture(scope="module")
def file(folder: Path) -> Path:
    path = folder / "bytes"
    path.write_bytes(np.random.default_rng(1).bytes(READ))
    yield path
    path.unlink()


def read_all(path: Path) -> int:
    reader = Reader(SharedFile(path), CHUNK)
    reader.window(0, READ)
    return sum(len(reader.read(CHUNK // 2)) for _ in range(READ // (CHUNK // 2)))


@pytest.mark.benchmark(group="256 MiB read forwards")
def test_reader(benchmark: Any, file: Path) -> None:
    assert benchmark.pedantic(read_all, (file,), rounds=7) == READ


@pytest.mark.benchmark(group="256 MiB read forwards")
def test_dd(benchmark: Any, file: Path) -> None:
    command = ["dd", f"if={file}", "of=/dev/null", f"bs={CHUNK}", "status=none"]
    benchmark.pedantic(lambda: subprocess.run(command, check=True), rounds=7)


def lines(count: int) -> tuple[np.ndarray, np.ndarray]:
    """Rays around the origin."""
    random = np.random.default_rng(2)
    origins = random.normal(size=(count, 3)) * 3
    return origins, random.normal(size=(count, 3)) * 0.3 - origins


@pytest.mark.benchmark(group="a walk through 256 voxels an axis")
def test_walk(benchmark: Any) -> None:
    grid = Grid((-1, -1, -1), (1, 1, 1), (256, 256, 256), 2.0**-30)
    steps = benchmark(lambda: len(grid.walk((-3.0, -2.9, -3.1), (1.0, 0.9, 1.02))))
    assert steps > 256


@pytest.mark.benchmark(group="100,000 box tests")
def test_boxes(benchmark: Any) -> None:
    origins, directions = lines(100_000)
    boxes = np.array([[-0.5, -0.5, -0.5, 0.5, 0.5, 0.5]] * len(origins), np.float32)
    assert len(benchmark(spans, boxes, 1e-9, origins, directions)) == len(boxes)


RECORDS = {
    Kind.SPHERE: [0, 0, 0, 0.5],
    Kind.CONE: [0, 0, -0.5, 0.4, 0, 0, 0.5, 0.3],
    Kind.TRIANGLE: [-0.5, -0.5, 0, 0.5, -0.5, 0, 0, 0.5, 0],
    Kind.PATCH: [-0.5, -0.5, 0, 0.5, -0.5, 0, 0, 0.5, 0, *(0, 0, 1) * 3],
    Kind.POLYGON: [-0.5, -0.5, 0, 0.5, -0.5, 0, 0.5, 0.5, 0, -0.5, 0.5, 0],
}


@pytest.mark.benchmark(group="100,000 rays against one object")
@pytest.mark.parametrize("kind", list(Kind), ids=lambda kind: kind.label)
def test_intersector(benchmark: Any, kind: Kind) -> None:
    origins, directions = lines(100_000)
    record = np.array(RECORDS[kind], np.float64)
    t = benchmark(meet, kind, record, (0.0, 0.0, 0.0), 1e-9, origins, directions)[1]
    assert 0 < np.isfinite(t).sum() < len(t)


@pytest.mark.benchmark(group="boxes of 100,000 objects")
@pytest.mark.parametrize("kind", [Kind.SPHERE, Kind.CONE, Kind.TRIANGLE, Kind.PATCH])
def test_bounds(benchmark: Any, kind: Kind) -> None:
    records = np.random.default_rng(3).normal(size=(100_000, SCALARS[kind])).astype(np.float32)
    none = np.zeros(len(records), np.uint32)
    assert benchmark(prepare, kind, records, none, none, (0.0, 0.0, 0.0)).bad == -1


@pytest.mark.benchmark(group="a million boxes merged")
def test_hierarchy(benchmark: Any, tmp_path: Path) -> None:
    lo = np.sort(np.random.default_rng(4).uniform(0, 1, 1_000_000)).astype(np.float32)
    boxes = np.column_stack([lo] * 3 + [lo + 0.001] * 3)
    folders = (tmp_path / str(i) for i in range(1000))
    ratio, _ = Hierarchy().threshold(len(boxes), 1)

    def fresh() -> tuple[tuple[Any, ...], dict[str, Any]]:
        folder = next(folders)
        folder.mkdir()
        return (Level(folder / "level1", ratio * 6.0, False),), {}

    def merge(level: Level) -> None:
        level.add(boxes)
        level.finish()

    benchmark.pedantic(merge, setup=fresh, rounds=5)


@pytest.mark.benchmark(group="a million hits sorted by object")
@pytest.mark.parametrize("loads", [1, 10], ids=["in memory", "parted on disk"])
def test_sort(benchmark: Any, tmp_path: Path, loads: int) -> None:
    count, room = 1 << 40, 1_000_000 // loads
    stream = SimpleNamespace(number=0, count=count, expected_bytes=lambda: {"geometry": count})
    groups: Any = [SimpleNamespace(lazy=True, streams=[stream])]
    hits = np.zeros(loads * room, HIT)
    hits["id"] = np.random.default_rng(5).integers(0, count, len(hits))

    def fresh() -> tuple[tuple[Any, ...], dict[str, Any]]:
        spool = Spool(HIT, room, tmp_path)
        spool.append(hits)
        return (spool,), {}

    def ids(spool: Spool) -> np.ndarray:
        # Copied, for all loads are the same memory.
        return np.concatenate([load["id"].copy() for load, _ in HitLoads(spool, groups, room)])

    found = benchmark.pedantic(ids, setup=fresh, rounds=5)
    assert len(found) == len(hits) and (np.diff(found.astype(np.int64)) >= 0).all()


class Nothing:
    """A sink that keeps nothing."""

    def camera(self, camera: object) -> None: ...
    def light(self, light: object) -> None: ...
    def background(self, color: object) -> None: ...
    def material(self, material: object) -> int:
        return 0

    def append(self, kind: object, records: object, materials: object) -> None: ...
    def append_polygons(self, vertices: object, counts: object, materials: object) -> None: ...


@pytest.mark.benchmark(group="NFF text of rings 20")
def test_nff(benchmark: Any) -> None:
    text = io.StringIO()
    bfrt.spd.rings(20).write_nff(text)
    data = text.getvalue().encode()
    benchmark.extra_info["bytes"] = len(data)
    benchmark.pedantic(lambda: read_nff(io.BytesIO(data), Nothing()), rounds=5)
