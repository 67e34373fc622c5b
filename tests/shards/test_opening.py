"""Shards as the groups of one scene: the ids and the bits of one store of the same groups."""

from __future__ import annotations

import pickle
import shutil

import numpy as np
import pytest
from sharded_scenes import (
    QUERIES,
    SMALL,
    WAYS,
    assert_same_answer,
    assert_same_picture,
    both,
    rays,
    store_of,
)

import bfrt
from bfrt.errors import BfrtError, SettingError, StoreError
from bfrt.ids import index_of, stream_of
from bfrt.reference import exhaustive
from bfrt.shards.joining import join
from bfrt.shards.store import SHARED_MARKS, open_sharded


@pytest.fixture(scope="module")
def scenes(tmp_path_factory):
    """Both forms of the scene by order and number of shards, made when first asked for."""
    made = {}

    def of(order, shards):
        if (order, shards) not in made:
            folder = tmp_path_factory.mktemp(f"{order}{shards}")
            made[order, shards] = both(folder, shards, order)
        return made[order, shards]

    return of


@pytest.mark.parametrize(
    ("way", "shards"), [("base", 3), ("sg", 2), ("sgb", 1), ("sgb", 8), ("tree", 8)]
)
def test_queries_are_those_of_one_store(scenes, way, shards):
    one, sharded = scenes(WAYS[way], shards)
    for query in QUERIES:
        found = getattr(sharded, query)(*rays(), refine=way, **SMALL)
        expected = getattr(one, query)(*rays(), refine=way, **SMALL)
        assert_same_answer(found, expected)
    hit = sharded.cast_rays(*rays(), refine=way, **SMALL)["geometry_ids"]
    assert len(np.unique(hit)) > 20  # of all groups and kinds


@pytest.mark.parametrize(("way", "shards"), [("base", 8), ("sg", 3), ("sgb", 2), ("tree", 8)])
def test_pictures_are_those_of_one_store(scenes, way, shards):
    one, sharded = scenes(WAYS[way], shards)
    asked = {"refine": way, "aovs": ("position", "albedo"), **SMALL}
    found, expected = sharded.render(**asked), one.render(**asked)
    assert_same_picture(found, expected)
    rays_of = found.stats.total.rays
    assert rays_of.reflection > 100
    assert rays_of.refraction > 100
    assert rays_of.shadow > 100


def test_the_scene_is_described_as_one_store_is(scenes):
    one, sharded = scenes("given", 3)
    assert sharded.geometries == one.geometries
    assert sharded.objects == one.objects
    assert (sharded.camera, sharded.lights) == (one.camera, one.lights)
    assert sharded.background == one.background
    np.testing.assert_array_equal(sharded.bounds, one.bounds)
    shards = sharded.store.manifest.shards
    streams = [stream for shard in shards for stream in shard.streams]
    assert {s.number: s.objects for s in streams} == {n: g.count for n, g in one.geometries.items()}


def test_float64_shards_have_one_origin(tmp_path):
    one, sharded = both(tmp_path, 3, dtype="float64", origin=(1e6, 2e6, 0.0))
    origins = rays()[0] + [1e6, 2e6, 0.0]
    assert sharded.origin == (1e6, 2e6, 0.0)
    assert_same_answer(
        sharded.cast_rays(origins, rays()[1], **SMALL), one.cast_rays(origins, rays()[1], **SMALL)
    )


def test_shards_of_both_precisions(tmp_path):
    """Each shard keeps its own; the answer is that of trying all objects."""
    wide = store_of(tmp_path / "a.bfrt", [0, 1], dtype="float64", origin=(0, 0, 0))
    narrow = store_of(tmp_path / "b.bfrt", [2, 3], "spatial", origin=(0, 0, 0))
    join(tmp_path / "scene.bfrts", [wide.store, narrow.store])
    sharded = bfrt.open(tmp_path / "scene.bfrts")
    found = sharded.cast_rays(*rays(300), **SMALL)
    t, ids = exhaustive.nearest(sharded.store, *rays(300))
    hit = np.isfinite(t)
    assert 50 < hit.sum() < 300
    np.testing.assert_array_equal(found["t_hit"], t)
    np.testing.assert_array_equal(found["geometry_ids"][hit], stream_of(ids[hit]))
    np.testing.assert_array_equal(found["primitive_ids"][hit], index_of(ids[hit]))
    with pytest.raises(SettingError, match=r"scene\.bfrts.* expected base, sg or sgb"):
        sharded.cast_rays(*rays(3), refine="tree", **SMALL)


def test_shards_of_other_origins_are_refused(tmp_path):
    stores = [
        store_of(tmp_path / f"{n}.bfrt", [n], dtype="float64", origin=(n, 0, 0)).store
        for n in range(2)
    ]
    with pytest.raises(SettingError, match=r"1\.bfrt: found the origin \(1.*0\.bfrt: shards have"):
        join(tmp_path / "scene.bfrts", stores)
    assert not (tmp_path / "scene.bfrts").exists()


def test_some_shards_keep_their_ids_and_bounds(scenes):
    one, sharded = scenes("given", 8)
    some = bfrt.Scene(open_sharded(sharded.path, [5, 2]))
    np.testing.assert_array_equal(some.bounds, one.bounds)
    found = some.cast_rays(*rays(), **SMALL)
    whole = one.cast_rays(*rays(), **SMALL)
    own = np.isin(whole["geometry_ids"] >> 4, [2, 5])
    assert own.sum() > 50
    for key in whole:
        np.testing.assert_array_equal(found[key][own], whole[key][own])


def test_other_processes_take_a_scene(scenes):
    _, sharded = scenes("spatial", 3)
    copied = pickle.loads(pickle.dumps(sharded))
    assert_same_answer(copied.cast_rays(*rays(), **SMALL), sharded.cast_rays(*rays(), **SMALL))


def test_marks_are_kept_in_the_shards_and_used_again(tmp_path):
    _, sharded = both(tmp_path, 2)
    part = bfrt.open(tmp_path / "part1.bfrt")
    part.render(**SMALL)
    assert not sharded.render(**SMALL).stats.marks_reused
    assert sharded.render(**SMALL).stats.marks_reused
    assert part.render(**SMALL).stats.marks_reused  # its own are others, and still there
    assert len(list(tmp_path.rglob(SHARED_MARKS))) == 8
    sharded.verify()
    marks = tmp_path / "part1.bfrt" / "0" / SHARED_MARKS
    marks.write_bytes(marks.read_bytes()[:-1])
    with pytest.raises(StoreError, match=rf"{marks}: the marks are damaged"):
        sharded.verify()


def test_marks_of_shards_that_are_read_only_are_outside(tmp_path, monkeypatch):
    _, sharded = both(tmp_path / "scene", 2)
    monkeypatch.setattr("bfrt.grid.marks_home.os.access", lambda *_: False)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    scratch = tmp_path / "scratch"
    scratch.mkdir()
    assert not sharded.render(scratch=scratch, **SMALL).stats.marks_reused
    assert sharded.render(scratch=scratch, **SMALL).stats.marks_reused
    assert not list((tmp_path / "scene").rglob(SHARED_MARKS))
    assert len(list(scratch.rglob("*.marks"))) == 8
    assert not bfrt.clean(scratch)  # they are of a scene that is there
    assert len(list(scratch.rglob("*.marks"))) == 8


def test_a_folder_with_all_shards_may_move(tmp_path):
    _, sharded = both(tmp_path / "here", 3)
    expected = sharded.cast_rays(*rays(), **SMALL)
    shutil.move(tmp_path / "here", tmp_path / "there")
    moved = bfrt.open(tmp_path / "there" / "scene.bfrts")
    assert_same_answer(moved.cast_rays(*rays(), **SMALL), expected)


def test_a_link_leads_to_the_shards(tmp_path):
    _, sharded = both(tmp_path / "here", 3)
    (tmp_path / "there").mkdir()
    link = tmp_path / "there" / "link.bfrts"
    link.symlink_to(sharded.path)
    linked = bfrt.open(link)
    assert linked.path == link
    assert_same_answer(linked.cast_rays(*rays(), **SMALL), sharded.cast_rays(*rays(), **SMALL))
    linked.verify()


def test_a_missing_shard_is_named(tmp_path):
    both(tmp_path, 3)
    shutil.rmtree(tmp_path / "part1.bfrt")
    with pytest.raises(StoreError, match=r"part1\.bfrt: not a scene store"):
        bfrt.open(tmp_path / "scene.bfrts")


def test_a_replaced_shard_is_named(tmp_path):
    both(tmp_path, 3)
    store_of(tmp_path / "part1.bfrt", [7])
    with pytest.raises(
        StoreError,
        match=r"part1\.bfrt: found a store with .*it is not .*scene\.bfrts was made with",
    ):
        bfrt.open(tmp_path / "scene.bfrts")


def test_a_shard_replaced_while_the_scene_is_open(tmp_path):
    _, sharded = both(tmp_path, 3)
    sharded.cast_rays(*rays(10), **SMALL)
    store_of(tmp_path / "part1.bfrt", [7])
    with pytest.raises(StoreError, match=r"part1\.bfrt: the store was replaced"):
        sharded.verify()
    shutil.rmtree(tmp_path / "part1.bfrt")
    with pytest.raises(StoreError, match=r"part1\.bfrt: the store was removed"):
        sharded.verify()


def test_a_damaged_shard_is_named(tmp_path):
    _, sharded = both(tmp_path, 3)
    file = tmp_path / "part2.bfrt" / "0" / "sphere" / "geometry"
    data = bytearray(file.read_bytes())
    data[3] ^= 1
    file.write_bytes(data)
    with pytest.raises(StoreError, match=rf"{file}: the contents differ"):
        sharded.verify()


def test_the_files_of_a_shard_are_closed_where_another_is_missing(tmp_path, monkeypatch):
    both(tmp_path, 3)
    shutil.rmtree(tmp_path / "part2.bfrt")
    closed = []
    monkeypatch.setattr(
        "bfrt.store.folder.give_up", lambda number: closed.append(number), raising=True
    )
    with pytest.raises(BfrtError):
        bfrt.open(tmp_path / "scene.bfrts")
    assert len(closed) >= 2
