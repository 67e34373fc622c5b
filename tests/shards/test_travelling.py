"""Rays that travel to the workers that have the shards: the answers of one store."""

from __future__ import annotations

import os
import shutil

import numpy as np
import pytest
from cluster_fixtures import NEEDED, cluster_of
from shard_workers import spilled
from sharded_scenes import QUERIES, WAYS, assert_same_answer, both, rays, store_of

import bfrt
from bfrt.errors import BudgetError, Cancelled, SettingError, StoreError
from bfrt.shards.joining import join
from bfrt.wavefront import flight

pytest.importorskip("distributed", reason=NEEDED)

SMALL = {"memory": "160MiB", "threads": 1}


@pytest.fixture(scope="module")
def scenes(tmp_path_factory):
    """Both forms of the scene, by order."""
    return {order: both(tmp_path_factory.mktemp(order), 5, order) for order in ("given", "spatial")}


@pytest.fixture(autouse=True)
def small_blocks(monkeypatch):
    monkeypatch.setattr(flight, "BLOCK", 300)


@pytest.mark.parametrize("way", ["base", "sgb", "tree"])
def test_answers_are_those_of_one_store(scenes, way, shared_client, tmp_path):
    one, sharded = scenes[WAYS[way]]
    far = bfrt.open(sharded.path, client=shared_client)
    for query in QUERIES:
        found = getattr(far, query)(*rays(), refine=way, **SMALL)
        assert_same_answer(found, getattr(one, query)(*rays(), refine=way, **SMALL))
    assert len(far.workers) == 2
    assert sorted(n for numbers in far.workers.values() for n in numbers) == list(range(5))


def test_rays_of_other_shapes(scenes, shared_client, tmp_path):
    """Rows of six, maps, and one for all: answers have their shape."""
    one, sharded = scenes["given"]
    far = bfrt.open(sharded.path, client=shared_client)
    o, d = (np.asarray(part[:600]).reshape(20, 30, 3) for part in rays())
    six = np.concatenate([o, d], axis=-1)
    for query in QUERIES:
        for given in ((six,), (six.reshape(-1, 6).tolist(),), (o[0, 0], d), (o, d)):
            found = getattr(far, query)(*given, **SMALL)
            assert_same_answer(found, getattr(one, query)(*given, **SMALL))
        files = getattr(far, query)(six, out=tmp_path / query, **SMALL)
        assert_same_answer(files, getattr(one, query)(six, **SMALL))


def test_ends_of_rays_count(scenes, shared_client):
    one, sharded = scenes["given"]
    far = bfrt.open(sharded.path, client=shared_client)
    origins, directions = rays()
    rng = np.random.default_rng(3)
    ends = {"t_min": rng.uniform(-0.5, 0.5, len(origins)), "t_max": rng.uniform(0.3, 2.0, 700)}
    directions[5], directions[6] = 0.0, np.nan
    directions[7] *= 1e300
    origins[8] *= 1e9
    for query in QUERIES:
        found = getattr(far, query)(origins, directions, **ends, **SMALL)
        expected = getattr(one, query)(origins, directions, **ends, **SMALL)
        assert_same_answer(found, expected)
        assert found.stats.bad_rays == expected.stats.bad_rays == 2


def test_coincident_objects_tie_by_their_ids(tmp_path, shared_client):
    """The same group in each shard: of all hits at one t the least id counts."""
    for number in range(3):
        store_of(tmp_path / f"{number}.bfrt", [4])
    stores = [bfrt.open(tmp_path / f"{number}.bfrt").store for number in range(3)]
    join(tmp_path / "scene.bfrts", stores)
    far = bfrt.open(tmp_path / "scene.bfrts", client=shared_client)
    found = far.cast_rays(*rays(), **SMALL)
    hit = found["geometry_ids"] >= 0
    assert hit.sum() > 50
    assert (found["geometry_ids"][hit] >> 4 == 0).all()
    counts = far.count_intersections(*rays(), **SMALL)["counts"]
    once = bfrt.open(tmp_path / "1.bfrt").count_intersections(*rays(), **SMALL)["counts"]
    np.testing.assert_array_equal(counts, 3 * once)


def test_what_travels_is_counted(scenes, shared_client):
    one, sharded = scenes["given"]
    far = bfrt.open(sharded.path, client=shared_client)
    stats = far.cast_rays(*rays(), **SMALL).stats
    travel = stats.travel
    assert 0 < travel.rays <= 2 * 700
    assert travel.bytes_sent <= 88 * travel.rays
    assert travel.bytes_received <= 60 * travel.found
    assert travel.legs <= 2 * 2 * 3
    assert stats.as_dict()["travel"]["rays"] == travel.rays
    assert sum(own.total.rays.eye for own in stats.workers.values()) == travel.rays
    assert stats.objects == one.objects


def test_answers_go_to_arrays_and_files(scenes, shared_client, tmp_path):
    one, sharded = scenes["spatial"]
    far = bfrt.open(sharded.path, client=shared_client)
    np.save(tmp_path / "o.npy", rays()[0])
    np.save(tmp_path / "d.npy", rays()[1])
    out = {"t_hit": np.empty(700)}
    far.cast_rays(*rays(), out=out, **SMALL)
    listed = far.list_intersections(
        tmp_path / "o.npy", tmp_path / "d.npy", out=tmp_path / "hits", **SMALL
    )
    np.testing.assert_array_equal(out["t_hit"], one.cast_rays(*rays(), **SMALL)["t_hit"])
    assert_same_answer(listed, one.list_intersections(*rays(), **SMALL))
    with pytest.raises(SettingError, match="expected arrays or files"):
        far.cast_rays([rays()], **SMALL)


def test_a_frame_is_rendered_by_workers_that_open_all_shards(scenes, shared_client):
    one, sharded = scenes["spatial"]
    found = sharded.render(client=shared_client, memory="160MiB")
    expected = one.render(memory="160MiB", threads=1)
    for name, pixels in expected.channels.items():
        np.testing.assert_array_equal(found.channels[name], pixels, err_msg=name)


def test_the_scene_is_described(scenes, shared_client):
    one, sharded = scenes["given"]
    far = bfrt.open(sharded.path, client=shared_client)
    assert far.geometries == one.geometries
    assert (far.objects, far.origin, far.camera) == (one.objects, one.origin, one.camera)
    assert (far.lights, far.background) == (one.lights, one.background)
    np.testing.assert_array_equal(far.bounds, one.bounds)
    assert repr(far).endswith("objects, 2 workers>")


def test_no_ray_and_rays_that_meet_nothing(scenes, shared_client):
    one, sharded = scenes["given"]
    far = bfrt.open(sharded.path, client=shared_client)
    for n in (0, 4):
        asked = np.full((n, 3), 100.0), np.full((n, 3), 1.0)
        found = far.cast_rays(*asked, **SMALL)
        assert_same_answer(found, one.cast_rays(*asked, **SMALL))
        assert found.stats.travel.rays == 0


def test_progress_and_cancel(scenes, shared_client):
    far = bfrt.open(scenes["given"].sharded.path, client=shared_client)
    told = []
    far.cast_rays(*rays(), progress=told.append, **SMALL)
    assert [(each.done, each.total) for each in told] == [(300, 700), (600, 700), (700, 700)]
    with pytest.raises(Cancelled):
        far.cast_rays(*rays(), progress=lambda _: False, **SMALL)


def test_what_memory_does_not_hold_is_on_the_workers_disk(scenes, shared_client):
    sharded = scenes["given"].sharded
    found = shared_client.submit(spilled, str(sharded.path), sharded.store.checksum).result()
    scratch, own = found
    assert scratch == own


def test_a_budget_beyond_the_workers_limit(scenes, shared_client):
    far = bfrt.open(scenes["given"].sharded.path, client=shared_client)
    with pytest.raises(BudgetError, match=r"found 8192MiB, expected \d+MiB or less: worker \d"):
        far.cast_rays(*rays(), memory="8GiB")


def test_tree_needs_shards_in_spatial_order(scenes, shared_client):
    far = bfrt.open(scenes["given"].sharded.path, client=shared_client)
    with pytest.raises(SettingError, match=r"found 'tree' for .*expected base, sg or sgb"):
        far.cast_rays(*rays(), refine="tree", **SMALL)


def test_a_shard_that_no_worker_can_open(tmp_path, shared_client):
    _, sharded = both(tmp_path, 3)
    shutil.rmtree(tmp_path / "part1.bfrt")
    with pytest.raises(StoreError, match=r"^tcp:.*: shard 1 cannot be opened: .*part1\.bfrt: not"):
        bfrt.open(sharded.path, client=shared_client)


def test_a_shard_that_goes_meanwhile(tmp_path, shared_client):
    _, sharded = both(tmp_path, 3)
    far = bfrt.open(sharded.path, client=shared_client)
    far.cast_rays(*rays(), **SMALL)
    store_of(tmp_path / "part1.bfrt", [7])
    with pytest.raises(StoreError, match=r"^worker \d \(tcp.*\): .*part1\.bfrt: the store was rep"):
        far.cast_rays(*rays(), **SMALL)


def test_other_scenes_are_refused(scenes, shared_client):
    with pytest.raises(SettingError, match=r"one\.bfrt, expected a sharded scene \(\.bfrts\)"):
        bfrt.open(scenes["given"].one.path, client=shared_client)


def test_a_killed_worker_is_replaced(tmp_path):
    """Its process ends while rays are on their way; Dask begins another."""
    one, sharded = both(tmp_path, 5)
    with cluster_of(2) as client:
        far = bfrt.open(sharded.path, client=client)
        pids = client.run(os.getpid)
        victim = min(far.workers)

        def kill(progress):
            if progress.done == 300:
                os.kill(pids[victim], 9)

        found = far.cast_rays(*rays(), progress=kill, **SMALL)
        assert_same_answer(found, one.cast_rays(*rays(), **SMALL))
        assert victim not in client.scheduler_info()["workers"]
