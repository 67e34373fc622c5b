"""What a scene writer is given is what the store holds, or there is no store."""

from __future__ import annotations

import errno
import itertools
import logging
import os
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from meshes import open_files
from scenes import random_objects

import bfrt
from bfrt.errors import DiskFullError, SceneError, SettingError, StoreError, StreamError
from bfrt.records import Kind
from bfrt.store import atomic_folder, record_writer
from bfrt.store.model import Camera, Light, Material
from bfrt.store.store import open_store
from bfrt.store.writer import StoreWriter
from bfrt.streams.writer import FileWriter

UTM = np.array([500_000.0, 5_400_000.0, 300.0])
SMALL = np.array([[[0, 0, 0], [0.05, 0, 0], [0, 0.05, 0]]])
CAMERA = Camera((0.0, 0.0, 5.0), (0.0, 0.0, 0.0), (0.0, 1.0, 0.0))


def scene(seed=1, n=60, dtype=np.float32, spread=10.0):
    """Tables of all kinds: {kind: records}, vertices and counts of polygons."""
    objects = random_objects(np.random.default_rng(seed), n, spread=spread)
    part = objects.counts > 3
    vertices = objects.vertices[np.repeat(part, objects.counts)]
    tables = {
        Kind.SPHERE: objects.spheres,
        Kind.CONE: objects.cones,
        Kind.TRIANGLE: objects.triangles.reshape(-1, 9),
        Kind.PATCH: objects.patches.reshape(-1, 18),
        Kind.POLYGON: vertices,
    }
    return {kind: table.astype(dtype) for kind, table in tables.items()}, objects.counts[part]


def give(writer, tables, counts, materials=None):
    """All of it through the public methods."""
    s, c, t, p, v = (tables[kind] for kind in Kind)
    writer.spheres(s[:, :3], s[:, 3], materials)
    writer.cones(c[:, :3], c[:, 3], c[:, 4:7], c[:, 7], materials)
    writer.triangles(t.reshape(-1, 3, 3), materials)
    writer.patches(p[:, :9].reshape(-1, 3, 3), p[:, 9:].reshape(-1, 3, 3), materials)
    writer.polygons(v, counts, materials)


def contents(path):
    return {
        str(file.relative_to(path)): file.read_bytes()
        for file in sorted(path.rglob("*"))
        if file.is_file() and file.name != "made.json"  # which has times in it
    }


def boxes_of(stream):
    return np.fromfile(stream.path("boxes"), "<f4").reshape(-1, 6)


@pytest.fixture
def folder(tmp_path):
    """A folder that has nothing but what ends on .bfrt after the test."""
    yield tmp_path
    assert [path.name for path in tmp_path.iterdir() if path.suffix != ".bfrt"] == []


# --- what is stored ------------------------------------------------------------------------------


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_geometry_is_stored_untouched(folder, dtype):
    tables, counts = scene(dtype=dtype)
    with StoreWriter(folder / "a.bfrt", order="given") as writer:
        give(writer, tables, counts)
    store = open_store(folder / "a.bfrt")
    store.verify()
    assert [stream.kind for stream in store.streams] == list(Kind)
    for stream in store.streams:
        assert stream.path("geometry").read_bytes() == tables[stream.kind].tobytes()
        assert stream.wide == (dtype == np.float64)
        assert stream.degenerate == 0
    assert store.objects == sum(len(tables[kind]) for kind in Kind if kind < 4) + len(counts)
    polygons = store.streams[-1]
    ends = np.fromfile(polygons.path("offsets"), "<u4")
    np.testing.assert_array_equal(ends, np.cumsum(counts))
    assert (polygons.vertices, polygons.largest) == (counts.sum(), counts.max())


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
@pytest.mark.parametrize("kind", [Kind.TRIANGLE, Kind.PATCH])
def test_boxes_are_the_tightest_around_the_vertices(folder, dtype, kind):
    tables, _ = scene(n=400, dtype=dtype)
    with StoreWriter(folder / "a.bfrt", order="given") as writer:
        writer.append(kind, tables[kind])
    (stream,) = open_store(folder / "a.bfrt").streams
    origin = np.array(open_store(folder / "a.bfrt").origin)
    assert origin.any() == (dtype == np.float64)
    corners = tables[kind][:, :9].astype(np.float64).reshape(-1, 3, 3) - origin
    boxes = boxes_of(stream)
    lo, hi = corners.min(axis=1), corners.max(axis=1)
    assert (boxes[:, :3] <= lo).all()
    assert (boxes[:, 3:] >= hi).all()
    up, down = np.float32(np.inf), np.float32(-np.inf)
    assert (np.nextafter(boxes[:, :3], up) > lo).all()
    assert (np.nextafter(boxes[:, 3:], down) < hi).all()


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_boxes_hold_cones_and_polygons(folder, dtype):
    tables, counts = scene(n=400, dtype=dtype)
    with StoreWriter(folder / "a.bfrt", order="given") as writer:
        give(writer, tables, counts)
    store = open_store(folder / "a.bfrt")
    cones, polygons = store.streams[Kind.CONE], store.streams[Kind.POLYGON]
    # Cones: circles of 64 points around both ends.
    data = tables[Kind.CONE].astype(np.float64)
    axis = data[:, 4:7] - data[:, :3]
    axis /= np.linalg.norm(axis, axis=1)[:, None]
    one = np.cross(axis, np.eye(3)[np.abs(axis).argmin(axis=1)])
    one /= np.linalg.norm(one, axis=1)[:, None]
    two = np.cross(axis, one)
    boxes = boxes_of(cones).astype(np.float64)
    size = (boxes[:, 3:] - boxes[:, :3]).max()
    widest = np.full((len(data), 6), -np.inf)
    for turn, end in itertools.product(np.linspace(0, 2 * np.pi, 64), (0, 4)):
        radius = np.abs(data[:, end + 3 : end + 4])
        point = data[:, end : end + 3] + radius * (np.cos(turn) * one + np.sin(turn) * two)
        point -= store.origin
        assert (boxes[:, :3] <= point + 1e-14 * 10).all()
        assert (boxes[:, 3:] >= point - 1e-14 * 10).all()
        widest = np.maximum(widest, np.hstack([-point, point]))
    slack = np.hstack([-boxes[:, :3], boxes[:, 3:]]) - widest
    assert slack.max() < 0.01 * size  # and no wider than they must be
    owner = np.repeat(np.arange(len(counts)), counts)
    vertices = tables[Kind.POLYGON].astype(np.float64) - store.origin
    boxes = boxes_of(polygons)
    assert (boxes[owner, :3] <= vertices).all()
    assert (boxes[owner, 3:] >= vertices).all()


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_bounds_are_those_of_all_objects(folder, dtype):
    tables, counts = scene(n=300, dtype=dtype)
    with StoreWriter(folder / "a.bfrt", origin=(1.0, 2.0, 3.0), order="given") as writer:
        give(writer, tables, counts)
    store = open_store(folder / "a.bfrt")
    center, radius = np.split(tables[Kind.SPHERE].astype(np.float64), [3], axis=1)
    others = np.vstack([boxes_of(s) for s in store.streams if s.kind != Kind.SPHERE])
    lo = np.minimum((center - np.abs(radius) - store.origin).min(axis=0), others[:, :3].min(axis=0))
    hi = np.maximum((center + np.abs(radius) - store.origin).max(axis=0), others[:, 3:].max(axis=0))
    assert (store.bounds.lo <= lo).all()
    assert (store.bounds.hi >= hi).all()
    np.testing.assert_allclose(store.bounds.lo, lo, rtol=1e-6)
    np.testing.assert_allclose(store.bounds.hi, hi, rtol=1e-6)


def test_a_5_cm_triangle_at_utm_coordinates(folder):
    corners = UTM + SMALL
    with StoreWriter(folder / "a.bfrt", order="given") as writer:
        writer.triangles(corners)
    store = open_store(folder / "a.bfrt")
    np.testing.assert_allclose(store.origin, UTM, atol=0.05)
    box = boxes_of(store.streams[0])[0].astype(np.float64)
    sides = box[3:] - box[:3]
    np.testing.assert_allclose(sides, [0.05, 0.05, 0.0], atol=1e-8)
    assert store.streams[0].degenerate == 0


def test_a_5_cm_triangle_survives_as_float32(folder):
    corners = UTM + SMALL
    with StoreWriter(folder / "a.bfrt", dtype="float32") as writer:
        writer.triangles(corners)
    store = open_store(folder / "a.bfrt")
    (stream,) = store.streams
    assert not stream.wide
    assert stream.degenerate == 0
    stored = np.fromfile(stream.path("geometry"), "<f4").reshape(1, 3, 3)
    np.testing.assert_allclose(stored + np.array(store.origin), corners, atol=1e-8)


@pytest.mark.parametrize("dtype", ["float32", "float64"])
@pytest.mark.parametrize("given", [np.float32, np.float64])
def test_dtype_overrides(folder, dtype, given):
    tables, counts = scene(dtype=given)
    with StoreWriter(folder / "a.bfrt", dtype=dtype, origin=(0, 0, 0), order="given") as writer:
        give(writer, tables, counts)
    for stream in open_store(folder / "a.bfrt").streams:
        expected = tables[stream.kind].astype(dtype)
        assert stream.path("geometry").read_bytes() == expected.tobytes()
        assert stream.wide == (dtype == "float64")


def test_normals_and_radii_are_not_moved(folder):
    tables, counts = scene(dtype=np.float64)
    origin = np.array([10.0, -20.0, 30.0])
    with StoreWriter(folder / "a.bfrt", dtype="float32", origin=origin, order="given") as writer:
        give(writer, tables, counts)
    moved = {
        Kind.SPHERE: [*origin, 0],
        Kind.CONE: [*origin, 0, *origin, 0],
        Kind.TRIANGLE: [*origin] * 3,
        Kind.PATCH: [*origin] * 3 + [0] * 9,
        Kind.POLYGON: origin,
    }
    for stream in open_store(folder / "a.bfrt").streams:
        expected = (tables[stream.kind] - np.array(moved[stream.kind])).astype(np.float32)
        assert stream.path("geometry").read_bytes() == expected.tobytes()


@pytest.mark.parametrize("order", ["<", ">"])
@pytest.mark.parametrize("size", [4, 8])
def test_numbers_in_any_byte_order(folder, order, size):
    centers = np.arange(12).reshape(4, 3).astype(f"{order}f{size}")
    with StoreWriter(folder / "a.bfrt") as writer:
        writer.spheres(centers, 1)
    (stream,) = open_store(folder / "a.bfrt").streams
    records = np.fromfile(stream.path("geometry"), f"<f{size}").reshape(-1, 4)
    np.testing.assert_array_equal(records[:, :3], centers)
    np.testing.assert_array_equal(records[:, 3], 1)


def test_polygons_of_three_are_triangles(folder):
    rng = np.random.default_rng(2)
    counts = np.array([3, 5, 3, 3, 4])
    vertices = rng.random((counts.sum(), 3)).astype(np.float32)
    with StoreWriter(folder / "a.bfrt") as writer:
        numbers = [writer.material(Material(kd=kd / 8)) for kd in range(5)]
        writer.polygons(vertices, counts, numbers)
    triangles, polygons = open_store(folder / "a.bfrt").streams
    parts = np.split(vertices, np.cumsum(counts)[:-1])
    for stream, which in ((triangles, [0, 2, 3]), (polygons, [1, 4])):
        expected = np.concatenate([parts[i] for i in which])
        assert stream.path("geometry").read_bytes() == expected.tobytes()
        assert np.fromfile(stream.path("materials"), "u1").tolist() == which


@settings(max_examples=30, deadline=None)
@given(
    cuts=st.lists(st.floats(0, 1), max_size=5),
    seed=st.integers(0, 9),
    dtype=st.sampled_from([np.float32, np.float64]),
    backwards=st.booleans(),
)
def test_any_number_of_calls_gives_the_same_bytes(tmp_path_factory, cuts, seed, dtype, backwards):
    folder = tmp_path_factory.mktemp("calls")
    tables, counts = scene(seed, n=400, dtype=dtype)
    rng = np.random.default_rng(seed)
    chosen = {k: rng.integers(0, 300, len(counts if k == 4 else tables[k])) for k in Kind}
    for name, parts in (("one", [0, 1]), ("many", sorted([0, 1, *cuts]))):
        with StoreWriter(folder / name, origin=(1.0, 2.0, 3.0), order="given") as writer:
            for number in range(300):
                writer.material(Material(kd=number / 512))
            pairs = list(itertools.product(itertools.pairwise(parts), Kind))
            if backwards and name == "many":  # kinds take turns in another order
                pairs = sorted(pairs, key=lambda pair: (pair[0], -pair[1]))
            for (a, b), kind in pairs:
                n = len(chosen[kind])
                first, last = int(a * n), int(b * n)
                if kind == Kind.POLYGON:
                    ends = np.array([0, *np.cumsum(counts)])
                    vertices = tables[kind][ends[first] : ends[last]]
                    writer.append_polygons(vertices, counts[first:last], chosen[kind][first:last])
                else:
                    writer.append(kind, tables[kind][first:last], chosen[kind][first:last])
    assert contents(folder / "one") == contents(folder / "many")


def test_one_row_at_a_time(folder):
    tables, _ = scene(n=100)
    rows = tables[Kind.SPHERE]
    with StoreWriter(folder / "one.bfrt") as writer:
        writer.spheres(rows[:, :3], rows[:, 3])
    with StoreWriter(folder / "rows.bfrt") as writer:
        for row in rows:
            writer.spheres(row[None, :3], row[3])
    assert contents(folder / "one.bfrt") == contents(folder / "rows.bfrt")


def test_blocks_are_cut_without_a_trace(folder, monkeypatch):
    tables, counts = scene(n=100)
    for name, block in (("whole.bfrt", 65536), ("cut.bfrt", 7)):
        monkeypatch.setattr(record_writer, "BOXES_AT_ONCE", block)
        with StoreWriter(folder / name) as writer:
            numbers = [writer.material(Material(kd=kd / 512)) for kd in range(300)]
            give(writer, tables, counts, numbers[0])
            writer.triangles(np.eye(3, dtype=np.float32)[None], numbers[299])
    assert contents(folder / "whole.bfrt") == contents(folder / "cut.bfrt")


def test_empty_calls_add_nothing(folder):
    with StoreWriter(folder / "a.bfrt") as writer:
        give(writer, *scene(n=0))
        writer.spheres(np.empty((0, 3)), np.empty(0))
    store = open_store(folder / "a.bfrt")
    assert store.objects == 0
    assert store.bounds.empty
    assert store.groups[0].gridded == 0
    store.verify()


def test_the_view_and_the_lights(folder):
    lights = [Light((1.0, 2.0, 3.0)), Light((4, 5, 6), (0.5, 0.25, 1))]
    with StoreWriter(folder / "a.bfrt") as writer:
        writer.camera(CAMERA)
        writer.background((0.25, 0.5, 1))
        for light in lights:
            writer.light(light)
        assert writer.complete() is not None
    store = open_store(folder / "a.bfrt")
    assert store.camera == CAMERA
    assert store.lights == lights
    assert store.background == (0.25, 0.5, 1.0)


def test_numpy_numbers_in_the_view_and_the_lights(folder):
    three = np.arange(3, dtype=np.float32)
    with StoreWriter(folder / "a.bfrt") as writer:
        writer.camera(
            Camera(three + 1, three, (0, 0, 1), np.float32(30), np.int64(1), np.array([4, 3]))
        )
        writer.light(Light(three, three))
        writer.background(three)
    store = open_store(folder / "a.bfrt")
    assert store.camera == Camera((1, 2, 3), (0, 1, 2), (0, 0, 1), 30.0, 1.0, (4, 3))
    assert store.lights == [Light((0, 1, 2), (0, 1, 2))]


def test_bad_lights_are_refused_when_they_are_given(folder):
    with StoreWriter(folder / "a.bfrt") as writer:
        for light in (Light((np.nan, 0, 0)), Light((0, 0)), Light((0, 0, 0), ("a", "b", "c"))):
            with pytest.raises(SceneError, match="light"):
                writer.light(light)
        with pytest.raises(SceneError, match="background"):
            writer.background((np.inf, 0, 0))
    assert open_store(folder / "a.bfrt").lights == []


# --- materials -----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("blocks", "width"),
    [
        ([[5, 5], [5]], 0),
        ([[300], [300, 300]], 0),
        ([[0], [1]], 1),
        ([[0, 255], [3]], 1),
        ([[0, 1], [256]], 2),
        ([[300, 300], [2]], 2),  # the first, not yet written down, is the widest
        ([[0], [0], [65535]], 2),
        ([[0], [65536]], 4),
        ([[1], [2], [300], [70_000], [3]], 4),
        ([[70_000], [70_000], [0]], 4),
    ],
)
def test_materials_take_the_smallest_integers(folder, blocks, width):
    with StoreWriter(folder / "a.bfrt", order="given") as writer:
        writer._palette.count = 1 << 20  # as if they had been added
        for block in blocks:
            writer.spheres(np.zeros((len(block), 3), np.float32), 1.0, block)
        header = writer._header()
        files = {p.name for p in (writer._folder.aside / "0" / "sphere").iterdir()}
        path = writer._folder.aside / "0" / "sphere" / "materials"
        (stream,) = header["groups"][0]["streams"]
        assert (stream["material_bytes"], stream["material"]) == (width, blocks[0][0])
        assert files == {"geometry", "level1", *(["materials"] if width else [])}
        if width:
            assert np.fromfile(path, f"<u{width}").tolist() == list(itertools.chain(*blocks))
        writer.abandon()


def test_many_materials_of_a_block_before_the_first_difference(folder, monkeypatch):
    monkeypatch.setattr(record_writer, "BOXES_AT_ONCE", 10)
    with StoreWriter(folder / "a.bfrt") as writer:
        for kd in range(3):
            writer.material(Material(kd=kd))
        writer.spheres(np.zeros((25, 3), np.float32), 1.0, 2)
        writer.spheres(np.zeros((1, 3), np.float32), 1.0, 0)
    (stream,) = open_store(folder / "a.bfrt").streams
    assert np.fromfile(stream.path("materials"), "u1").tolist() == [2] * 25 + [0]


def test_a_material_is_stored_once(folder):
    red, blue = Material((1, 0, 0), ks=0.5), Material((0, 0, 1))
    with StoreWriter(folder / "a.bfrt") as writer:
        assert [writer.material(m) for m in (red, blue, red, blue)] == [0, 1, 0, 1]
    palette = open_store(folder / "a.bfrt").materials()
    assert palette["red"].tolist() == [1, 0]
    assert palette["ks"].tolist() == [0.5, 0]


@pytest.mark.parametrize("bad", [Material(kd=-1), Material(ks=np.nan), Material(shine=1e300)])
def test_a_bad_material_is_refused(folder, bad):
    with StoreWriter(folder / "a.bfrt") as writer:
        with pytest.raises(SceneError, match="material: found"):
            writer.material(bad)
        assert writer.material(Material()) == 0


@pytest.mark.parametrize("bad", [[0, 1, 2], -1, [0, -7], 2, [0.0, 1.0], [[0, 1]], True])
def test_a_bad_material_index_is_refused(folder, bad):
    with StoreWriter(folder / "a.bfrt") as writer:
        writer.material(Material())
        writer.material(Material(kd=0.5))
        with pytest.raises(SceneError, match="materials: found") as caught:
            writer.spheres(np.zeros((2, 3), np.float32), 1.0, bad)
        if bad == [0, -7]:
            assert "index -7" in str(caught.value)
        writer.spheres(np.zeros((2, 3), np.float32), 1.0, [0, 1])
    assert open_store(folder / "a.bfrt").objects == 2


# --- what is refused -----------------------------------------------------------------------------


def test_degenerate_objects_are_counted_and_reported_once(folder, caplog):
    flat = np.zeros((2, 3, 3), np.float32)
    flat[1] = [[0, 0, 0], [1, 1, 1], [2, 2, 2]]
    with caplog.at_level(logging.WARNING), StoreWriter(folder / "a.bfrt", order="given") as writer:
        writer.triangles(flat)
        writer.triangles(np.eye(3, dtype=np.float32)[None])
        writer.spheres(np.zeros((2, 3), np.float32), [0.0, 1.0])
        writer.cones([[0, 0, 0]] * 2, 1, [[0, 0, 0], [0, 0, 1]], [1, 0], 0)
        writer.polygons(np.ones((4, 3), np.float32), [4])
    store = open_store(folder / "a.bfrt")
    assert [s.degenerate for s in store.streams] == [1, 1, 2, 1]
    assert [s.count for s in store.streams] == [2, 2, 3, 1]
    assert store.groups[0].gridded + len(store.groups[0].outliers) == 3
    assert len(caplog.records) == 1
    assert "5 degenerate objects" in caplog.text
    assert str(folder / "a.bfrt") in caplog.text
    boxes = boxes_of(store.streams[Kind.TRIANGLE])
    assert (boxes[:2] == [np.inf] * 3 + [-np.inf] * 3).all()
    assert np.isfinite(boxes[2]).all()


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize("kind", [kind for kind in Kind if kind != Kind.POLYGON])
def test_what_is_not_finite_is_named(folder, dtype, bad, kind):
    tables, _ = scene(n=100, dtype=dtype)
    records = tables[kind]
    for column in range(records.shape[1]):
        broken = records.copy()
        broken[7, column] = bad
        with (
            pytest.raises(SceneError, match=rf"^{kind.label} {len(records) + 7}: found a number"),
            StoreWriter(folder / "a.bfrt") as writer,
        ):
            writer.append(kind, records)
            writer.append(kind, broken)
    with (
        pytest.raises(SceneError, match=rf"^{kind.label} 0: found a number that is NaN"),
        StoreWriter(folder / "a.bfrt") as writer,
    ):
        writer.append(kind, np.full_like(records[:1], bad))  # the first block decides the origin
    assert not (folder / "a.bfrt").exists()


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_a_vertex_that_is_not_finite_is_named(folder, dtype):
    tables, counts = scene(n=100, dtype=dtype)
    vertices = tables[Kind.POLYGON].copy()
    vertices[counts[:3].sum(), 1] = np.nan
    with (
        pytest.raises(SceneError, match=r"^polygon 3: found a number that is NaN"),
        StoreWriter(folder / "a.bfrt") as writer,
    ):
        writer.polygons(vertices, counts)


@pytest.mark.parametrize("far", [1e39, 1e308])
@pytest.mark.parametrize("dtype", [None, "float32"])
def test_what_float32_boxes_cannot_hold_is_named(folder, far, dtype):
    with (
        np.errstate(all="raise"),
        pytest.raises(SceneError, match=r"^triangle 1: .* too large for float32 boxes"),
        StoreWriter(folder / "a.bfrt", dtype=dtype, origin=(0, 0, 0)) as writer,
    ):
        writer.triangles(np.array([np.eye(3), far * np.eye(3)]))


@pytest.mark.parametrize("far", [1e39, 1e200, -1e308])
@pytest.mark.parametrize("dtype", [None, "float32"])
def test_normals_that_float32_has_not_are_named(folder, far, dtype):
    """Of longer ones the square is infinite, and there would be no shading normal."""
    normals = np.ones((2, 3, 3))
    normals[1, 2, 2] = far
    with (
        pytest.raises(SceneError, match=r"^patch 1: .* too large for float32"),
        StoreWriter(folder / "a.bfrt", dtype=dtype, origin=(0, 0, 0)) as writer,
    ):
        writer.patches(np.array([np.eye(3), np.eye(3)]), normals)


N3 = np.zeros((4, 3), np.float32)
N33 = np.zeros((4, 3, 3), np.float32)


@pytest.mark.parametrize(
    ("method", "arguments", "message"),
    [
        ("spheres", (N3[:, :2], 1), r"centers: found shape \(4, 2\), expected \(n, 3\)"),
        ("spheres", (N3[0], 1), r"centers: found shape \(3,\), expected \(n, 3\)"),
        ("spheres", (N3, [1, 2]), r"radii: found shape \(2,\), expected \(4,\)"),
        ("spheres", ([[1, 2, 3], [4, 5]], 1), "centers: found no array, expected numbers"),
        ("spheres", ([["a", "b", "c"]], 1), "centers: found .*U1, expected numbers"),
        ("spheres", (N3 + 1j, 1), "centers: found complex64, expected numbers"),
        ("cones", (N3, 1, N3[:3], 1), "apexes: found 3 rows, expected 4"),
        ("cones", (N3, 1, N3, -1), "radii of both signs"),
        ("triangles", (N3,), r"vertices: found shape \(4, 3\), expected \(n, 3, 3\)"),
        ("patches", (N33, N33[:2]), "normals: found 2 rows, expected 4"),
        ("patches", (N33, N3), r"normals: found shape \(4, 3\), expected \(n, 3, 3\)"),
        ("polygons", (N3[:, :2], [4]), r"vertices of shape \(4, 2\), expected \(m, 3\)"),
        ("polygons", (N3, [5]), "found 4 vertices for counts of 5 in all"),
        ("polygons", (N3, [2, 2]), "each count 3 or more"),
        ("polygons", (N3, [4.0]), "counts of float64"),
        ("polygons", (N3, 4), r"counts of int64 and shape \(\), expected integers"),
        ("polygons", (N3, [2**63 - 1, 2**63 - 1, 6]), "each count 3 or more"),
        ("polygons", (N3, np.array([2**63, 2**63, 4], np.uint64)), "each count 3 or more"),
        ("append", (Kind.CONE, N3), r"cone: found records of shape \(4, 3\), expected \(n, 8\)"),
        ("append", (Kind.POLYGON, N3), "polygon: found records"),
    ],
)
def test_wrong_shapes_are_refused_and_the_writer_goes_on(folder, method, arguments, message):
    with StoreWriter(folder / "a.bfrt") as writer:
        with pytest.raises(SceneError, match=message):
            getattr(writer, method)(*arguments)
        writer.spheres(N3, 1)
    assert open_store(folder / "a.bfrt").objects == 4


def test_a_wide_block_after_a_narrow_one_is_refused(folder):
    with (
        pytest.raises(SceneError, match="sphere: found a block of float64, expected float32"),
        StoreWriter(folder / "a.bfrt") as writer,
    ):
        writer.spheres(N3, 1)
        writer.spheres(N3.astype(np.float64), 1)


def test_more_vertices_than_offsets_can_count(folder):
    with StoreWriter(folder / "a.bfrt") as writer:
        writer.polygons(N3, [4])
        writer._groups[0].streams[Kind.POLYGON].vertices = (1 << 32) - 4
        with pytest.raises(SceneError, match=r"polygon 1: found more than 2\^32 vertices"):
            writer.polygons(N3, [4])
        writer.abandon()


@pytest.mark.parametrize("dtype", [np.float16, "int32", "complex64"])
def test_a_dtype_that_is_not_stored(folder, dtype):
    with pytest.raises(SettingError, match="expected float32, float64 or None"):
        StoreWriter(folder / "a.bfrt", dtype=dtype)


@pytest.mark.parametrize("origin", [(1, 2), (1, 2, np.nan), "abc"])
def test_a_bad_origin(folder, origin):
    with pytest.raises(SceneError, match="origin: found"):
        StoreWriter(folder / "a.bfrt", origin=origin)


# --- whole or not at all -------------------------------------------------------------------------


@pytest.mark.parametrize("error", [RuntimeError, KeyboardInterrupt, SystemExit])
def test_an_exception_leaves_nothing(folder, error):
    with pytest.raises(error), StoreWriter(folder / "a.bfrt") as writer:
        give(writer, *scene())
        raise error
    assert list(folder.iterdir()) == []


@pytest.mark.parametrize("error", [RuntimeError, KeyboardInterrupt])
def test_an_existing_store_is_replaced_only_on_success(folder, error):
    path = folder / "a.bfrt"
    with StoreWriter(path) as writer:
        writer.spheres(N3, 1)
    old = contents(path)
    (path / "0" / "marks").write_bytes(b"old marks go with their store")
    with pytest.raises(error), StoreWriter(path) as writer:
        give(writer, *scene())
        raise error
    assert contents(path) == {**old, "0/marks": b"old marks go with their store"}
    with StoreWriter(path) as writer:
        writer.spheres(N3, 2)
    assert set(contents(path)) == set(old)
    assert contents(path) != old
    assert [p.name for p in folder.iterdir()] == ["a.bfrt"]


def test_a_store_of_another_version_may_be_replaced(folder):
    path = folder / "a.bfrt"
    path.mkdir()
    (path / "scene.json").write_text('{"magic": "bfrt scene store", "version": 0}')
    StoreWriter(path).complete()
    assert open_store(path).objects == 0


@pytest.mark.parametrize("there", ["file", "folder", "project", "scene.json of others", "damaged"])
def test_what_is_no_store_is_never_replaced(folder, there):
    path = folder / "a.bfrt"
    if there == "file":
        path.write_bytes(b"mine")
    else:
        path.mkdir()
        text = {"folder": None, "project": "[1]", "damaged": "{"}.get(there, '{"magic": "x"}')
        if text:
            (path / "scene.json").write_text(text)
            (path / "work").write_text("mine")
    before = contents(path)
    with pytest.raises(SettingError, match=r"a\.bfrt: exists and is no scene store"):
        StoreWriter(path)
    assert contents(path) == before
    assert path.exists()
    assert [p.name for p in folder.iterdir()] == ["a.bfrt"]


def test_a_link_stays_a_link(tmp_path):
    (tmp_path / "there").mkdir()
    link = tmp_path / "a.bfrt"
    try:
        link.symlink_to(tmp_path / "there" / "b.bfrt")
    except OSError:
        pytest.skip("no symbolic links here")
    for radius in (1, 2):
        with StoreWriter(link) as writer:
            writer.spheres(N3, radius)
    assert link.is_symlink()
    assert [p.name for p in (tmp_path / "there").iterdir()] == ["b.bfrt"]
    assert sorted(p.name for p in tmp_path.iterdir()) == ["a.bfrt", "there"]
    assert open_store(link).objects == 4


def test_two_writers_of_one_store_do_not_meet(folder):
    one, two = StoreWriter(folder / "a.bfrt"), StoreWriter(folder / "a.bfrt")
    one.spheres(N3, 1)
    two.spheres(N3[:2], 1)
    assert one.complete().objects == 4
    assert two.complete().objects == 2
    open_store(folder / "a.bfrt").verify()


def test_a_long_name(folder):
    path = folder / ("é" * 120 + ".bfrt")
    StoreWriter(path).complete()
    assert [p.name for p in folder.iterdir()] == [path.name]


def test_a_closed_writer_takes_no_more(folder):
    with StoreWriter(folder / "a.bfrt") as writer:
        writer.spheres(N3, 1)
        writer.complete()  # and leaving the block is fine
    for call in (
        writer.complete,
        lambda: writer.spheres(N3, 1),
        lambda: writer.polygons(N3, [4]),
        lambda: writer.material(Material(kd=0.125)),
    ):
        with pytest.raises(SettingError, match="the writer is closed"):
            call()
    assert open_store(folder / "a.bfrt").objects == 4


def test_half_a_block_is_never_kept(folder, monkeypatch):
    """An interrupt in a block that the caller catches: the store is given up, not continued."""
    writer = StoreWriter(folder / "a.bfrt")
    writer.triangles(N33)
    real = FileWriter.write

    def interrupted(self, data, **how):
        if self.path.name == "boxes":
            raise KeyboardInterrupt
        real(self, data, **how)

    monkeypatch.setattr(FileWriter, "write", interrupted)
    with pytest.raises(KeyboardInterrupt):
        writer.triangles(N33)
    monkeypatch.undo()
    with pytest.raises(SettingError, match="closed"):
        writer.triangles(N33)
    assert list(folder.iterdir()) == []


@pytest.mark.parametrize(
    ("owner", "name", "least"),
    [
        (os, "write", 5),
        (os, "fsync", 14),
        (os, "open", 18),
        (Path, "rename", 3),
        (Path, "mkdir", 6),
    ],
)
def test_a_refusal_at_any_call_leaves_nothing(folder, monkeypatch, caplog, owner, name, least):
    """The system refuses the first call of a sort, then the second, and so on."""
    path = folder / "a.bfrt"
    real = getattr(owner, name)
    if name == "rename":
        monkeypatch.setattr(atomic_folder, "exchange", by_renames)
    for refused in itertools.count(1):
        with StoreWriter(path, order="given") as writer:
            writer.spheres(N3, 1)
        old, calls = contents(path), itertools.count(1)

        def refuse(*arguments, refused=refused, calls=calls, **named):
            if next(calls) == refused:
                raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
            return real(*arguments, **named)

        before = open_files()
        caplog.clear()
        with monkeypatch.context() as patch:
            patch.setattr(owner, name, refuse)
            try:
                with StoreWriter(path, order="given") as writer:
                    writer.material(Material())
                    give(writer, *scene(), 0)
                    writer.triangles(N33, writer.material(Material(kd=0.5)))
                replaced = True
            except DiskFullError as error:
                assert str(folder) in str(error)
                replaced = False
        assert open_files() == before
        if replaced:
            open_store(path).verify()
            for left in folder.glob(".*"):  # only the old store, and not in silence
                assert left.suffix == (".old" if name == "rename" else ".part")
                assert "could not be removed" in caplog.text
                shutil.rmtree(left)
            if next(calls) <= refused:
                break
        else:
            assert contents(path) == old
        assert [p.name for p in folder.iterdir()] == ["a.bfrt"]
    assert refused > least


def by_renames(one, other):
    """The system cannot exchange two names."""
    return False


def test_an_interrupt_after_the_exchange(folder, monkeypatch):
    path = folder / "a.bfrt"
    StoreWriter(path, order="given").complete()
    old = contents(path)
    real = atomic_folder.exchange

    def interrupted(one, other):
        assert real(one, other)
        monkeypatch.undo()
        raise KeyboardInterrupt

    writer = StoreWriter(path, order="given")
    writer.spheres(N3, 1)
    monkeypatch.setattr(atomic_folder, "exchange", interrupted)
    with pytest.raises(KeyboardInterrupt):
        writer.complete()
    assert contents(path) == old


@pytest.mark.parametrize("when", ["old away", "new in place"])
@pytest.mark.parametrize("replaces", [True, False])
def test_an_interrupt_between_the_renames(folder, monkeypatch, when, replaces):
    monkeypatch.setattr(atomic_folder, "exchange", by_renames)
    path = folder / "a.bfrt"
    if replaces:
        StoreWriter(path, order="given").complete()
    old = contents(path)
    real = Path.rename

    def interrupted(self, target):
        result = real(self, target)
        if (when == "new in place") == (Path(target) == path) and Path(target).suffix != ".part":
            monkeypatch.setattr(Path, "rename", real)
            raise KeyboardInterrupt
        return result

    writer = StoreWriter(path, order="given")
    writer.spheres(N3, 1)
    monkeypatch.setattr(Path, "rename", interrupted)
    if when == "old away" and not replaces:
        writer.complete()
        assert open_store(path).objects == 4
        return
    with pytest.raises(KeyboardInterrupt):
        writer.complete()
    assert contents(path) == old
    assert path.exists() == replaces


def test_what_the_disk_lost_replaces_nothing(folder, monkeypatch):
    path = folder / "a.bfrt"
    StoreWriter(path).complete()
    old = contents(path)
    writer = StoreWriter(path)
    writer.spheres(np.zeros((100_000, 3), np.float32), 1)
    real = FileWriter.close

    def lost(self):
        real(self)
        if self.path.name == "palette":
            os.truncate(self.path, 10)

    monkeypatch.setattr(FileWriter, "close", lost)
    with pytest.raises(StoreError, match="truncated"):
        writer.complete()
    assert contents(path) == old


def test_a_full_disk(folder):
    """A limit of file size stands for a full disk: the system refuses in the middle."""
    resource = pytest.importorskip("resource", reason="no limits of file size here")
    old = resource.getrlimit(resource.RLIMIT_FSIZE)
    handler = signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    try:
        with pytest.raises(StreamError) as caught, StoreWriter(folder / "a.bfrt") as writer:
            resource.setrlimit(resource.RLIMIT_FSIZE, (1 << 20, old[1]))
            writer.spheres(np.zeros((100_000, 3), np.float32), 1)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, old)
        signal.signal(signal.SIGXFSZ, handler)
    assert caught.value.errno == errno.EFBIG
    assert caught.value.offset == 1 << 20
    assert "geometry: writing at byte 1048576" in str(caught.value)
    assert list(folder.iterdir()) == []


KILLED = """
import sys
import numpy as np
from bfrt import SceneWriter
centers = np.zeros((100_000, 3), np.float32)
with SceneWriter(sys.argv[1]) as writer:
    print("begun", flush=True)
    for _ in range(40):
        writer.spheres(centers, 1)
        writer.triangles(np.eye(3, dtype=np.float32)[None])
"""


@pytest.mark.skipif(not hasattr(signal, "SIGKILL"), reason="no SIGKILL here")
@pytest.mark.parametrize("after", [0.0, 0.02, 0.1, 0.2])
def test_a_killed_writer_leaves_nothing_that_opens(tmp_path, after):
    path = tmp_path / "a.bfrt"
    source = str(Path(bfrt.__file__).parents[1])
    process = subprocess.Popen(
        [sys.executable, "-c", KILLED, str(path)],
        stdout=subprocess.PIPE,
        env={**os.environ, "PYTHONPATH": source},
        cwd=Path(path.anchor),  # not the source tree, which has no compiled modules
    )
    assert process.stdout.readline() == b"begun\n"
    time.sleep(after)
    process.send_signal(signal.SIGKILL)
    process.communicate()
    for left in tmp_path.iterdir():
        if left == path:
            open_store(left).verify()  # it was faster than the signal
        else:
            with pytest.raises(StoreError, match="not a scene store"):
                open_store(left)
    with StoreWriter(path) as writer:  # and nothing is in the way of another try
        writer.spheres(N3, 1)
    assert open_store(path).objects == 4


KILLED_BETWEEN = """
import os, signal, sys
from pathlib import Path
import numpy as np
from bfrt import SceneWriter
from bfrt.store import atomic_folder

def killed(path, target, rename=Path.rename):
    rename(path, target)
    if Path(target).suffix == ".old":
        os.kill(os.getpid(), signal.SIGKILL)

Path.rename = killed
atomic_folder.exchange = lambda one, other: False
with SceneWriter(sys.argv[1]) as writer:
    writer.spheres(np.eye(3, dtype=np.float32), 1)
"""


@pytest.mark.skipif(not hasattr(signal, "SIGKILL"), reason="no SIGKILL here")
@pytest.mark.parametrize("lost", [False, True])
def test_a_writer_that_is_killed_between_the_renames(tmp_path, lost):
    """Who opens the store finds the new one; or the old one, if the disk has lost the new."""
    path = tmp_path / "a.bfrt"
    with StoreWriter(path) as writer:
        writer.spheres(N3, 1)
    source = str(Path(bfrt.__file__).parents[1])
    command = [sys.executable, "-c", KILLED_BETWEEN, str(path)]
    environment = {**os.environ, "PYTHONPATH": source}
    done = subprocess.run(command, env=environment, cwd=tmp_path, check=False)
    assert done.returncode == -signal.SIGKILL
    assert not path.exists()
    (new,) = tmp_path.glob(".*.part")
    if lost:
        (new / "scene.json").write_bytes(b"")
    assert open_store(path).objects == (4 if lost else 3)
    bfrt.clean(tmp_path)
    assert [each.name for each in tmp_path.iterdir()] == ["a.bfrt"]
    open_store(path).verify()


#: The first of two elements has no value.
MASKED = np.ma.masked_equal([7, 1], 7)


@pytest.mark.parametrize(
    ("call", "arguments", "name"),
    [
        ("spheres", (np.ma.masked_less(np.eye(2, 3), 1), 1.0), "centers"),
        ("spheres", (np.zeros((2, 3)), MASKED), "radii"),
        ("spheres", (np.zeros((2, 3)), np.ma.masked), "radii"),
        ("spheres", (np.zeros((2, 3)), 1.0, MASKED), "materials"),
        ("spheres", ([np.ma.masked_less([1, 2, 3], 2)] * 2, 1.0), "centers"),
        ("cones", (np.zeros((2, 3)), MASKED, np.ones((2, 3)), 1.0), "base_radii"),
        ("cones", (np.zeros((1, 3)), 1.0, np.ma.masked_less(np.eye(1, 3), 1), 1.0), "apexes"),
        ("triangles", (np.ma.masked_less(np.ones((1, 3, 3)), 2),), "vertices"),
        ("patches", (np.ones((1, 3, 3)), np.ma.masked_less(np.ones((1, 3, 3)), 2)), "normals"),
        ("polygons", (np.ma.masked_less(np.eye(4, 3), 1), [4]), "vertices"),
        ("polygons", (np.eye(4, 3), np.ma.masked_equal([4], 4)), "counts"),
        ("append", (Kind.SPHERE, np.ma.masked_less(np.eye(2, 4), 1)), "sphere"),
        ("background", (np.ma.masked_less(np.eye(1, 3)[0], 1),), "background"),
        ("light", (Light(np.ma.masked_less(np.eye(1, 3)[0], 1)),), "light"),
    ],
)
def test_masked_elements_are_refused(folder, call, arguments, name):
    """What is below a mask is no number that somebody meant."""
    writer = StoreWriter(folder / "a.bfrt")
    with pytest.raises(SceneError, match=f"^{name}: found masked elements, expected numbers$"):
        getattr(writer, call)(*arguments)
    writer.abandon()
    with pytest.raises(SceneError, match=r"^origin: found masked elements"):
        StoreWriter(folder / "a.bfrt", origin=np.ma.masked_less(np.eye(1, 3)[0], 1))


@pytest.mark.parametrize("dtype", ["foo", "f2", int, 7])
def test_a_dtype_that_is_none_of_the_two(folder, dtype):
    with pytest.raises(SettingError, match=r"dtype: found .*, expected float32, float64 or None"):
        StoreWriter(folder / "a.bfrt", dtype=dtype)


@pytest.mark.parametrize("name", ["n" * 300, "new/" + "n" * 300])
def test_too_long_a_name_is_found_before_the_work(folder, name):
    with pytest.raises(SettingError, match="found too long a name"):
        StoreWriter(folder / name)


def test_a_masked_array_without_a_masked_element_is_one(folder):
    with StoreWriter(folder / "a.bfrt") as writer:
        writer.material(Material())
        writer.spheres(np.ma.zeros((2, 3)), np.ma.ones(2), np.ma.zeros(2, int))
    assert open_store(folder / "a.bfrt").objects == 2


def test_a_group_between_others_may_be_empty(tmp_path):
    """As one of several files may be without objects: the groups behind it keep their numbers."""
    files = [tmp_path / f"{number}.npy" for number in range(4)]
    for file, count in zip(files, (5, 0, 7, 0), strict=True):
        np.save(file, np.random.default_rng(count).uniform(size=(count, 3)))
    scene = bfrt.convert(files, tmp_path / "a.bfrt", radius=0.6, durable=False)
    assert {g.group: g.count for g in scene.geometries.values()} == {0: 5, 2: 7}
    assert len(scene.store.groups) == 4
    for refine in ("base", "sgb", "tree"):
        hits = scene.cast_rays([[0.5, 0.5, 9.0]] * 3, [[0, 0, -1.0]] * 3, refine=refine)
        assert (hits["t_hit"] < 10).all()
