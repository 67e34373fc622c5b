"""Pictures made where the shards are, on a cluster: the bits of one process."""

from __future__ import annotations

import dataclasses
import os
import signal

import numpy as np
import pytest
from cluster_fixtures import NEEDED, cluster_of, executing, wait_until
from shading import LIT
from sharded_scenes import WAYS, assert_same_picture, both, standard, store_of

import bfrt
from bfrt.errors import BudgetError, Cancelled, SettingError, StoreError
from bfrt.wavefront import far_shading, ferry, frame

pytest.importorskip("distributed", reason=NEEDED)

SMALL = {"memory": "160MiB", "threads": 1}
AOVS = ("position", "albedo")


@pytest.fixture(scope="module")
def scenes(tmp_path_factory):
    """Both forms of the scene, by order."""
    return {order: both(tmp_path_factory.mktemp(order), 5, order) for order in ("given", "spatial")}


@pytest.fixture(autouse=True)
def small_blocks(monkeypatch):
    for module in (ferry, frame, far_shading):
        monkeypatch.setattr(module, "BLOCK", 1000)


@pytest.mark.parametrize("way", ["base", "sgb", "tree"])
def test_two_workers_make_the_picture(scenes, way, shared_client):
    one, sharded = scenes[WAYS[way]]
    far = bfrt.open(sharded.path, client=shared_client)
    expected = one.render(refine=way, aovs=AOVS, **SMALL)
    found = far.render(refine=way, aovs=AOVS, **SMALL)
    assert_same_picture(found, expected)
    assert found.metadata == sharded.render(refine=way, aovs=AOVS, **SMALL).metadata
    stats, total = found.stats, expected.stats.total
    assert stats.total.rays == total.rays
    assert total.rays.reflection and total.rays.refraction and total.rays.shadow
    assert stats.settings == {"refine": way, "memory": 160 << 20, "threads": 1, "depth": 5}
    assert len(stats.workers) == 2
    assert len(stats.grids) == len(expected.stats.grids)
    if way == "tree":
        assert stats.tree["treelets"] == expected.stats.tree["treelets"]
    for name in ("object_tests", "box_tests", "node_tests", "passes", "geometry_read"):
        each = [getattr(own.total, name) for own in stats.workers.values()]
        assert getattr(stats.total, name) == sum(each)
    assert stats.peak_rss_bytes == max(own.peak_rss_bytes for own in stats.workers.values()) > 0


@pytest.mark.parametrize("way", ["sgb", "tree"])
def test_light_that_is_asked_for(scenes, way, shared_client):
    one, sharded = scenes[WAYS[way]]
    far = bfrt.open(sharded.path, client=shared_client)
    expected = one.render(refine=way, **LIT, **SMALL)
    found = far.render(refine=way, **LIT, **SMALL)
    assert_same_picture(found, expected)
    assert found.stats.total.rays == expected.stats.total.rays
    assert found.metadata == sharded.render(refine=way, **LIT, **SMALL).metadata


def test_what_travels_is_counted(scenes, shared_client):
    one, sharded = scenes["given"]
    stats = bfrt.open(sharded.path, client=shared_client).render(depth=2, **SMALL).stats
    local = one.render(depth=2, **SMALL).stats
    assert len(stats.travel) == len(local.depths) == 3
    first, second, third = stats.travel
    rays = local.depths[0].rays
    assert first.rays == rays.eye and first.shading.hits == rays.eye_hits
    assert first.shading.rays == second.rays
    assert second.rays == rays.reflection + rays.refraction + rays.shadow
    assert second.shading.rays == third.rays == local.depths[1].rays.shadow
    assert third.shading.hits == third.shading.rays == 0
    for depth in stats.travel:
        traced, shaded = depth.tracing, depth.shading
        assert 0 < traced.rays <= 2 * depth.rays
        assert 0 < traced.bytes_sent <= 88 * traced.rays
        assert 0 < traced.bytes_received <= 20 * traced.found
        assert shaded.bytes_sent <= 88 * shaded.hits
        assert shaded.bytes_of_rays <= 72 * shaded.rays
        assert shaded.bytes_of_film <= (36 + 28) * shaded.elements
        assert shaded.elements <= shaded.hits
        assert depth.bytes == sum(
            (traced.bytes_sent, traced.bytes_received, shaded.bytes_sent, shaded.bytes_of_rays,
             shaded.bytes_of_film)
        )  # fmt: skip
    told = stats.as_dict()["travel"]
    assert told[0]["tracing"]["rays"] == first.tracing.rays and len(told) == 3


def test_settings_are_the_shards_own(scenes, shared_client):
    one, sharded = scenes["spatial"]
    far = bfrt.open(sharded.path, client=shared_client)
    camera = dataclasses.replace(one.camera, resolution=(25, 17))
    found = far.render(camera=camera, samples=2, depth=3, **SMALL)
    assert found.stats.settings["refine"] == "tree"
    assert_same_picture(found, one.render(camera=camera, samples=2, depth=3, **SMALL))
    assert far.render(camera=camera, grid=9, **SMALL).stats.settings["refine"] == "sgb"


def test_marks_are_made_again(scenes, shared_client):
    far = bfrt.open(scenes["given"].sharded.path, client=shared_client)
    for fresh in (False, True, False):
        stats = far.render(depth=1, fresh_marks=fresh, **SMALL).stats
    assert stats.marks_reused and not stats.total.phases.preprocess.bytes_read
    stats = far.render(depth=1, fresh_marks=True, **SMALL).stats
    assert not stats.marks_reused
    made = [own.total.phases.preprocess.bytes_read for own in stats.workers.values()]
    assert len(made) == 2 and all(made)


def test_progress_and_cancel(scenes, shared_client):
    far = bfrt.open(scenes["given"].sharded.path, client=shared_client)
    told = []
    stats = far.render(progress=told.append, **SMALL).stats
    assert [p.depth for p in told] == sorted(p.depth for p in told)
    for depth, counted in enumerate(stats.travel, 1):
        done = [p.done for p in told if p.depth == depth]
        assert done[0] == 0 and done == sorted(done) and done[-1] == counted.rays
        assert {p.total for p in told if p.depth == depth} == {counted.rays}
    with pytest.raises(Cancelled, match="cancelled at depth 2, with 0 of"):
        far.render(progress=lambda p: p.depth < 2, **SMALL)
    wait_until(lambda: not any(shared_client.run(executing).values()))
    assert not shared_client.futures


def test_what_cannot_be_honoured_is_refused(scenes, shared_client, tmp_path):
    far = bfrt.open(scenes["given"].sharded.path, client=shared_client)
    with pytest.raises(SettingError, match=r"^checkpoint: found one for a scene on a cluster"):
        far.render(checkpoint=tmp_path / "kept", **SMALL)
    with pytest.raises(SettingError, match=r"^samples: found 0"):
        far.render(samples=0, **SMALL)
    with pytest.raises(SettingError, match=r"^ao: found -1"):
        far.render(ao=-1, **SMALL)
    with pytest.raises(SettingError, match=r"found 'tree' for .*expected base, sg or sgb"):
        far.render(refine="tree", **SMALL)
    with pytest.raises(BudgetError, match=r"found 8192MiB, expected \d+MiB or less: worker \d"):
        far.render(memory="8GiB")
    with pytest.raises(BudgetError, match=r"^memory: found 20MiB, expected \d+MiB or more"):
        far.render(memory="20MiB")


def test_a_shard_that_goes_meanwhile(tmp_path, shared_client):
    _, sharded = both(tmp_path, 3)
    far = bfrt.open(sharded.path, client=shared_client)

    def replace(progress):
        if (progress.depth, progress.done) == (2, 0):
            store_of(tmp_path / "part1.bfrt", [7])

    with pytest.raises(StoreError, match=r"^worker \d \(tcp.*\): .*part1\.bfrt: the store was rep"):
        far.render(progress=replace, **SMALL)


def test_a_killed_worker_is_replaced(tmp_path):
    """Its process ends while rays are on their way; Dask begins another."""
    one, sharded = both(tmp_path, 5)
    with cluster_of(2) as client:
        far = bfrt.open(sharded.path, client=client)
        pids = client.run(os.getpid)
        victim = min(far.workers)
        killed = []

        def kill(progress):
            if progress.depth == 2 and progress.done and not killed:
                killed.append(progress.done)
                os.kill(pids[victim], signal.SIGKILL)

        found = far.render(progress=kill, aovs=AOVS, **SMALL)
        assert killed and victim not in client.scheduler_info()["workers"]
        expected = one.render(aovs=AOVS, **SMALL)
        assert_same_picture(found, expected)
        assert found.stats.total.rays == expected.stats.total.rays


@pytest.mark.slow
@pytest.mark.parametrize("workers", [1, 2])
def test_all_standard_scenes(tmp_path, workers):
    with cluster_of(workers) as client:
        for name in bfrt.spd.NAMES:
            recipe = bfrt.spd.scene(name, 3)
            camera = dataclasses.replace(recipe.camera, resolution=(64, 64))
            for order, ways in (("given", ("base", "sgb")), ("spatial", ("tree",))):
                scene = standard(tmp_path / f"{name}-{order}", recipe, 4, order)
                far = bfrt.open(scene.sharded.path, client=client)
                for way in ways:
                    settings = {"refine": way, "camera": camera, "aovs": AOVS, **SMALL}
                    found, expected = far.render(**settings), scene.one.render(**settings)
                    assert_same_picture(found, expected)
                    assert found.stats.total.rays == expected.stats.total.rays
                    assert np.isfinite(found.channels["Z"]).any()
