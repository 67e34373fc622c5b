"""What all standard scenes share, on a scene small enough to read."""

from __future__ import annotations

import io
import re
from functools import partial

import numpy as np
import pytest
from running import thread_name

import bfrt
from bfrt.errors import Cancelled, DiskFullError
from bfrt.records import Kind
from bfrt.spd.blocks import Part
from bfrt.spd.recipe import SpdScene, phong_power
from bfrt.store.model import Camera, Light, Material

PLACE = np.zeros(1, np.int64)


class Row(SpdScene):
    """Spheres in a row, one a block, red up to the last, which is green; then a pentagon."""

    name = "row"
    camera = Camera(eye=(0.0, 0.0, 0.0), at=(1.0, 0.0, 0.0))
    lights = (Light((1.0, 2.0, 1e-7)),)
    background = (0.0, 0.5, 1.0)
    materials = (Material((1.0, 0.0, 0.0)), Material((0.0, 1.0, 0.0)))

    @property
    def counts(self):
        return {Kind.SPHERE: self.size, Kind.POLYGON: 1}

    @property
    def vertices(self):
        return 5

    def tasks(self, limit=1):
        for x in range(self.size):
            yield partial(self.sphere, x)
        yield self.pentagon

    def sphere(self, x, dtype):
        records = np.array([[x, 0, 0, 0.5]], dtype)
        return (Part(Kind.SPHERE, records, np.array([x == self.size - 1], np.uint32), PLACE),)

    def pentagon(self, dtype):
        corners = np.arange(15, dtype=dtype).reshape(5, 3)
        return (Part(Kind.POLYGON, corners, np.ones(1, np.uint32), PLACE, np.array([5])),)


def test_text_names_a_material_only_where_it_changes_across_blocks_too():
    file = io.StringIO()
    Row(3).write_nff(file)
    assert file.getvalue().splitlines() == [
        "b 0 0.5 1",
        "v",
        "from 0 0 0",
        "at 1 0 0",
        "up 0 0 1",
        "angle 45",
        "hither 1",
        "resolution 512 512",
        "l 1 2 1e-07",
        "f 1 0 0 1 0 1 0 1",
        "s 0 0 0 0.5",
        "s 1 0 0 0.5",
        "f 0 1 0 1 0 1 0 1",
        "s 2 0 0 0.5",
        "p 5",
        "0 1 2",
        "3 4 5",
        "6 7 8",
        "9 10 11",
        "12 13 14",
    ]


@pytest.mark.parametrize(
    ("degrees", "power"), [(0, 100000), (-1, 100000), (60, 1), (90, 1), (120, 1), (45, 2)]
)
def test_phong_power_halves_the_highlight(degrees, power):
    assert phong_power(degrees) == pytest.approx(power, rel=1e-12)


@pytest.mark.parametrize("threads", [1, 2, 5])
def test_threads_change_nothing(threads, tmp_path):
    one, other = io.StringIO(), io.StringIO()
    Row(40).write_nff(one, threads=1)
    Row(40).write_nff(other, threads=threads)
    assert one.getvalue() == other.getvalue()
    one, other = (Row(40).write(tmp_path / f"{n}.bfrt", threads=n).store for n in (1, threads))
    assert one.checksum == other.checksum


def test_what_a_store_takes_is_known_beforehand(tmp_path):
    store = Row(5).write(tmp_path / "row.bfrt")
    files = [f for f in (tmp_path / "row.bfrt").rglob("*") if f.is_file()]
    on_disk = sum(
        f.stat().st_size for f in files if not re.match("scene|made|level|quantised", f.name)
    )
    assert 0 <= Row(5).store_bytes - on_disk <= store.objects  # one material takes no bytes
    assert store.objects == Row(5).objects == 6


def test_a_disk_without_room_is_refused_before_anything_is_written(tmp_path, monkeypatch):
    monkeypatch.setattr("shutil.disk_usage", lambda path: type("", (), {"free": 10})())
    needed = Row(5).store_bytes + Row(5).hierarchy_bytes
    with pytest.raises(DiskFullError, match=f"writing {needed} bytes where 10 are free"):
        Row(5).write(tmp_path / "row.bfrt")
    assert list(tmp_path.iterdir()) == []


def test_progress_counts_objects_and_cancels(tmp_path):
    seen = []
    Row(3).write(tmp_path / "row.bfrt", progress=seen.append)
    assert seen == [1, 2, 3, 4]
    with pytest.raises(Cancelled, match="cancelled while writing, with 2 of 4 objects done"):
        Row(3).write(tmp_path / "other.bfrt", progress=lambda done: done < 2)
    with pytest.raises(Cancelled):
        Row(3).write_nff(io.StringIO(), progress=lambda done: False)
    assert [path.name for path in tmp_path.iterdir()] == ["row.bfrt"]


def test_a_failure_in_a_thread_is_the_callers(tmp_path):
    class Broken(Row):
        surface = 1.0

        def pentagon(self, dtype):
            raise ArithmeticError(thread_name())

    with pytest.raises(ArithmeticError, match="bfrt-ahead"):
        Broken(3).write(tmp_path / "row.bfrt", threads=2)
    assert list(tmp_path.iterdir()) == []


def test_text_comes_back_as_the_scene(tmp_path):
    path = tmp_path / "row.nff"
    with path.open("w") as file:
        Row(7).write_nff(file)
    scene = bfrt.convert(path, tmp_path / "row.bfrt")
    assert scene.camera == Row.camera
    assert {g.kind: g.count for g in scene.geometries.values()} == Row(7).counts
