"""Points asked about, and places of hits, where shards stay with workers: as of one store."""

from __future__ import annotations

import numpy as np
import pytest
from cluster_fixtures import NEEDED
from sharded_scenes import WAYS, assert_same_answer, assert_same_picture, both, rays

import bfrt
from bfrt.errors import Cancelled, SettingError
from bfrt.image.color_scale import ColorScale
from bfrt.shards.joining import join
from bfrt.wavefront import flight

pytest.importorskip("distributed", reason=NEEDED)

SMALL = {"memory": "160MiB", "threads": 1}
SIDES = ("incoming", "opposite", "front", "back")


@pytest.fixture(scope="module")
def scenes(tmp_path_factory):
    """Both forms of the scene, by order."""
    return {order: both(tmp_path_factory.mktemp(order), 5, order) for order in ("given", "spatial")}


@pytest.fixture(scope="module")
def points():
    """Points in the scene, some of which are none, and their normals."""
    rng = np.random.default_rng(11)
    p, n = rng.uniform(-5, 5, (2, 40, 3))
    p[3], n[5], n[7] = np.nan, 0.0, np.inf
    return p, n


@pytest.fixture(autouse=True)
def small_blocks(monkeypatch):
    monkeypatch.setattr(flight, "BLOCK", 300)


@pytest.mark.parametrize("way", ["base", "sgb", "tree"])
@pytest.mark.parametrize("side", SIDES)
def test_places_of_hits_are_those_of_one_store(scenes, way, side, shared_client):
    one, sharded = scenes[WAYS[way]]
    far = bfrt.open(sharded.path, client=shared_client)
    asked = {"outputs": ["positions", "next_origins"], "side": side, "refine": way, **SMALL}
    origins, directions = rays()
    origins[8] *= 1e9
    found = far.cast_rays(origins, directions, **asked)
    expected = one.cast_rays(origins, directions, **asked)
    assert_same_answer(found, expected)
    assert list(found) == list(expected)
    assert np.isinf(found["positions"]).any() and np.isfinite(found["positions"]).any()


def test_one_of_the_places(scenes, shared_client, tmp_path):
    one, sharded = scenes["given"]
    far = bfrt.open(sharded.path, client=shared_client)
    asked = {"outputs": ["next_origins"], **SMALL}
    expected = one.cast_rays(*rays(), **asked)
    assert_same_answer(far.cast_rays(*rays(), out=tmp_path / "out", **asked), expected)
    nothing = far.cast_rays(np.empty((0, 3)), np.empty((0, 3)), **asked)
    assert nothing["next_origins"].shape == (0, 3)
    with pytest.raises(SettingError, match=r"^outputs: found 'place'"):
        far.cast_rays(*rays(), outputs=["place"])
    with pytest.raises(SettingError, match=r"^side: found 'left'"):
        far.cast_rays(*rays(), side="left")


@pytest.mark.parametrize("way", ["base", "sgb", "tree"])
def test_visibility_is_that_of_one_store(scenes, way, points, shared_client):
    one, sharded = scenes[WAYS[way]]
    far = bfrt.open(sharded.path, client=shared_client)
    p, n = points
    for given, asked in (
        ((p, n), {}),
        ((p,), {"rays": 7, "distance": 2.0}),
        ((p.reshape(5, 8, 3), (0, 0, 1)), {"rays": 401, "cosine": True}),
    ):
        found = far.visibility(*given, refine=way, **asked, **SMALL)
        expected = one.visibility(*given, refine=way, **asked, **SMALL)
        assert_same_answer(found, expected)
        assert found.stats.bad_rays == expected.stats.bad_rays > 0
        assert 0 < np.nanmean(found["visibility"]) < 1


@pytest.mark.parametrize("way", ["base", "sgb", "tree"])
def test_inside_is_that_of_one_store(scenes, way, points, shared_client, caplog):
    one, sharded = scenes[WAYS[way]]
    far = bfrt.open(sharded.path, client=shared_client)
    p = np.concatenate([points[0], np.random.default_rng(3).uniform(-4, 4, (600, 3))])
    found = far.contains(p, refine=way, **SMALL)
    warned = [record.message for record in caplog.records]
    caplog.clear()
    expected = one.contains(p, refine=way, **SMALL)
    assert_same_answer(found, expected)
    assert warned == [record.message for record in caplog.records]
    assert set(np.unique(found["inside"])) == {-1, 0, 1}
    assert found.stats.unsure_points == expected.stats.unsure_points > 0
    assert found.stats.bad_rays == expected.stats.bad_rays == 2


def test_points_of_files_and_answers_to_files(scenes, points, shared_client, tmp_path):
    one, sharded = scenes["given"]
    far = bfrt.open(sharded.path, client=shared_client)
    np.save(tmp_path / "p.npy", points[0])
    np.save(tmp_path / "n.npy", points[1])
    given = tmp_path / "p.npy", tmp_path / "n.npy"
    found = far.visibility(*given, out=tmp_path / "out", **SMALL)
    assert_same_answer(found, one.visibility(*points, **SMALL))
    own = {"inside": np.empty(40, np.int8)}
    far.contains(given[0], out=own, **SMALL)
    np.testing.assert_array_equal(own["inside"], one.contains(points[0], **SMALL)["inside"])
    with pytest.raises(SettingError, match=r"^out: found inside of int8 and shape \(40,\)"):
        far.contains(points[0][:9], out=own, **SMALL)


def test_no_points(scenes, shared_client):
    far = bfrt.open(scenes["given"].sharded.path, client=shared_client)
    none = np.empty((0, 3))
    assert far.visibility(none, none)["visibility"].shape == (0,)
    assert far.contains(none.reshape(0, 4, 3))["inside"].shape == (0, 4)


def test_progress_of_points_and_cancel(scenes, points, shared_client):
    far = bfrt.open(scenes["given"].sharded.path, client=shared_client)
    told = []
    far.visibility(points[0], progress=told.append, **SMALL)
    assert [(each.done, each.total) for each in told][-1] == (2560, 2560)
    with pytest.raises(Cancelled):
        far.contains(points[0], progress=lambda _: False, **SMALL)


def test_a_preview_is_that_of_one_store(scenes, shared_client):
    one, sharded = scenes["spatial"]
    far = bfrt.open(sharded.path, client=shared_client)
    assert_same_picture(far.preview(24), one.preview(24))
    with pytest.raises(SettingError, match=r"^pixels: found 0"):
        far.preview(0)


def test_colors_are_those_of_all_shards(tmp_path, shared_client):
    stores = []
    for number, name in enumerate(["mass", "age", "mass"]):
        centers = np.random.default_rng(number).random((9, 3), np.float32)
        np.savez(tmp_path / "points.npz", positions=centers, **{name: np.arange(9.0)})
        store = tmp_path / f"{number}.bfrt"
        bfrt.convert(tmp_path / "points.npz", store, radius=0.1, color_by=name)
        stores.append(bfrt.open(store).store)
    join(tmp_path / "scene.bfrts", stores)
    far = bfrt.open(tmp_path / "scene.bfrts", client=shared_client)
    assert far.colors == bfrt.open(tmp_path / "scene.bfrts").colors
    assert far.colors == tuple(ColorScale(name, "viridis", 0.0, 8.0) for name in ("mass", "age"))
    assert "age: 0 to 8, viridis" in far._repr_html_()
