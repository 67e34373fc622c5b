"""Stores in spatial order: the same answers, pictures and ids as in the order given."""

from __future__ import annotations

import fast
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scenes import hard_scenes, random_objects, random_rays, twice

import bfrt
from bfrt.records import Kind
from bfrt.reference import exhaustive
from bfrt.scene import Scene
from bfrt.store.extent import bounds_of_points
from bfrt.store.model import Camera
from bfrt.store.ordering import order as order_module
from bfrt.store.ordering.objects import Layout, Objects
from bfrt.store.ordering.parts import Means, Source, as_they_come, by_place
from bfrt.store.store import open_store

NAMES = sorted(hard_scenes(np.random.default_rng(0)))
DTYPES = (np.float32, np.float64)
VIEW = Camera((0.1, -9.0, 1.0), (0.0, 0.0, 0.0), resolution=(24, 24))


def both(rng, objects, folder, dtype):
    """Two stores of the same objects, and rays."""
    objects = fast.stored(objects, dtype)
    stores = [fast.write(objects, folder / order, dtype, order=order) for order in ORDERS]
    rays = random_rays(rng, objects, 40).values()
    origins, directions = (np.concatenate(some) for some in zip(*rays, strict=True))
    return stores, origins, directions


ORDERS = ("given", "spatial")


@pytest.mark.parametrize("name", NAMES)
def test_hard_scenes(tmp_path, name):
    rng = np.random.default_rng([31, NAMES.index(name)])
    dtype = DTYPES[NAMES.index(name) % 2]
    stores, origins, directions = both(rng, hard_scenes(rng)[name], tmp_path, dtype)
    own = origins - np.array(stores[0].origin)
    expected = exhaustive.nearest(stores[0], own, directions)
    found = exhaustive.nearest(stores[1], own, directions)
    for one, other in zip(expected, found, strict=True):
        np.testing.assert_array_equal(one, other)
    scenes = [Scene(store) for store in stores]
    for refine in fast.OF_GRIDS:
        for ask in ("cast_rays", "occluded", "count_intersections", "list_intersections"):
            one, other = (getattr(s, ask)(origins, directions, refine=refine) for s in scenes)
            assert one.keys() == other.keys()
            for key in one:
                np.testing.assert_array_equal(one[key], other[key], err_msg=f"{refine} {key}")
        if stores[0].objects and not stores[0].bounds.empty:
            one, other = (s.render(camera=VIEW, refine=refine) for s in scenes)
            for channel in one.channels:
                np.testing.assert_array_equal(one.channels[channel], other.channels[channel])


@pytest.mark.parametrize("name", NAMES)
def test_a_store_in_order_has_every_object_once(tmp_path, name):
    objects = fast.stored(hard_scenes(np.random.default_rng(32))[name], np.float32)
    store = fast.write(objects, tmp_path / "s.bfrt", np.float32, order="spatial")
    store.verify()
    assert sorted(p.name for p in tmp_path.iterdir()) == ["s.bfrt"]
    for stream in open_store(store.path).streams:
        assert stream.ordered
        ids = np.fromfile(stream.path("ids"), f"<u{stream.id_bytes}")
        assert sorted(ids) == list(range(stream.count))
        assert not (stream.folder.parent / f"{stream.folder.name}.ordered").exists()


def source_of(boxes, kind=Kind.SPHERE, block=37):
    """Objects whose boxes have these centers, in blocks."""
    n = len(boxes)
    layout = Layout(kind, False, (0.0, 0.0, 0.0))
    records = np.zeros((n, kind.scalars), np.float32)
    records[:, :3], records[:, 3] = boxes[:, :3], 0.001
    whole = Objects(
        records.view(np.uint8).reshape(-1),
        np.empty(0, np.uint32),
        np.arange(n, dtype=np.uint32) % 7,
        np.arange(n, dtype=np.uint64),
    )
    firsts = range(0, n, block)
    around = bounds_of_points(np.ascontiguousarray(boxes[:, :3]))
    return Source(
        layout,
        lambda: (whole.between(a, min(n, a + block), layout) for a in firsts),
        around,
    )


@given(st.integers(1, 400), st.integers(1, 60), st.integers(0, 5), st.integers(0, 1000))
def test_windows_are_a_permutation_whatever_lies_together(tmp_path_factory, n, window, shape, seed):
    rng = np.random.default_rng(seed)
    centers = [
        rng.random((n, 3)),
        np.zeros((n, 3)),
        rng.integers(0, 2, (n, 3)).astype(float),
        2.0 ** rng.uniform(-60, 0, (n, 1)) * [1.0, 1.0, 0.0],
        np.where(rng.random((n, 1)) < 0.9, 0.5, rng.random((n, 3))),
        rng.random((n, 1)) * [1e-30, 0.0, 0.0],
    ][shape].astype(np.float32)
    means = Means(tmp_path_factory.mktemp("parts"), 2, window)
    for way in (by_place, as_they_come):
        windows = list(way(source_of(centers), means))
        assert all(0 < w.number <= window for w in windows)
        ids = np.concatenate([w.ids for w in windows])
        assert sorted(ids) == list(range(n))
        for some in windows:
            places = some.geometry.view(np.float32).reshape(-1, 4)[:, :3]
            np.testing.assert_array_equal(places, centers[some.ids.astype(int)])
            np.testing.assert_array_equal(some.materials, some.ids % 7)
        first = int(rng.integers(0, len(windows) + 1))
        done = sum(w.number for w in windows[:first])
        others = list(way(source_of(centers), means, done))
        assert [w.ids.tolist() for w in others] == [w.ids.tolist() for w in windows[first:]]
        for one, other in zip(windows[first:], others, strict=True):
            assert one.geometry.tobytes() == other.geometry.tobytes()
            assert one.materials.tobytes() == other.materials.tobytes()
    assert not list(means.scratch.iterdir())


def test_windows_by_place_are_compact(tmp_path):
    centers = np.random.default_rng(3).random((20000, 3)).astype(np.float32)
    windows = list(by_place(source_of(centers, block=4096), Means(tmp_path, 2, 500)))
    sides = []
    for some in windows:
        places = some.geometry.view(np.float32).reshape(-1, 4)[:, :3]
        sides.append(np.prod(places.max(0) - places.min(0)))
    assert len(windows) < 3 * 20000 / 500
    assert np.mean(sides) < 8 / len(windows)


def test_of_two_objects_at_one_place_the_first_given_is_hit(tmp_path):
    rng = np.random.default_rng(33)
    objects = fast.stored(twice(random_objects(rng, 400)), np.float32)
    stores, origins, directions = both(rng, objects, tmp_path, np.float32)
    found = [Scene(s).cast_rays(origins, directions)["primitive_ids"] for s in stores]
    np.testing.assert_array_equal(*found)
    assert (found[0] >= 0).any()


def test_windows_of_objects_that_nothing_can_hit(tmp_path, monkeypatch):
    """They have no treelet; what comes after them is found all the same."""
    monkeypatch.setattr(
        order_module, "Means", lambda scratch, threads, *_: Means(scratch, threads, 50)
    )
    rng = np.random.default_rng(34)
    corners = rng.uniform(-1, 1, (400, 4, 3))
    corners[150:260] = corners[150:260, :1]
    rays = rng.uniform(-2, 2, (300, 3)), rng.normal(size=(300, 3))
    for kind, table in (("triangles", corners[:, :3]), ("polygons", corners.reshape(-1, 3))):
        found = []
        for order in ORDERS:
            with bfrt.SceneWriter(tmp_path / f"{kind} {order}", order=order) as writer:
                getattr(writer, kind)(table, *([np.full(400, 4)] if kind == "polygons" else []))
            scene = bfrt.open(tmp_path / f"{kind} {order}")
            assert scene.store.streams[0].degenerate == 110
            found.append(scene.list_intersections(*rays))
        assert len(found[0]["ray_ids"]) > 100
        for key, values in found[0].items():
            np.testing.assert_array_equal(values, found[1][key])
