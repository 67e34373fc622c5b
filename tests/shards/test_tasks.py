"""What a worker does with rays that come, without a cluster: shards one after the other."""

from __future__ import annotations

import os

import numpy as np
import pytest
from sharded_scenes import WAYS, assert_same_answer, both, rays

from bfrt.cluster.asked import Asked
from bfrt.errors import SettingError, StoreError
from bfrt.ids import stream_of
from bfrt.queries.casting import hit_columns
from bfrt.queries.given import rays_of
from bfrt.queries.rays import RayQueue
from bfrt.records import NO_HIT, QUERY_RAY, RayKind
from bfrt.wavefront.cargo import Cargo
from bfrt.wavefront.carriers import ShardPlace, Sight, seen, shared_out
from bfrt.wavefront.flight import Block, blocks_of
from bfrt.wavefront.routing import boxes_of, entries
from bfrt.wavefront.tasks import Find, Trace


@pytest.fixture(scope="module")
def scenes(tmp_path_factory):
    return {order: both(tmp_path_factory.mktemp(order), 4, order) for order in ("given", "spatial")}


def block_of(store, find=Find.NEAREST):
    """All rays as a block, and each shard's entries."""
    queue = RayQueue(store, rays_of(*rays(), 0.0, np.inf).blocks, RayKind.EYE)
    (records,) = blocks_of(queue)
    boxes = boxes_of(store, store.manifest.shards)
    return Block(records, entries(records, boxes), find)


@pytest.mark.parametrize("way", WAYS)
def test_rays_come_with_hits_on_other_shards(scenes, way):
    """They keep them where no object is nearer, and those of others are not looked at."""
    one, sharded = scenes[WAYS[way]]
    asked = Asked("160MiB", 1, way, None, None, False, None)
    block = block_of(sharded.store)
    legs = 0
    while departing := list(block.departures()):
        for number, which in departing:
            place = ShardPlace(os.fspath(sharded.path), sharded.store.checksum, (number,))
            traced = Trace(place, asked, way, Find.NEAREST)(Cargo.of(block.rays[which]))
            block.take(traced.cargo.records(Find.NEAREST.value))
            legs += 1
    expected = one.cast_rays(*rays(), refine=way, memory="160MiB", threads=1)
    assert_same_answer(hit_columns(block.found), expected)
    assert legs > 4
    shards = stream_of(block.rays["id"][block.rays["id"] != NO_HIT]) >> np.uint64(5)
    assert len(np.unique(shards)) == 4


def test_a_ray_goes_only_where_a_nearer_hit_may_be(scenes):
    store = scenes["given"].sharded.store
    block = block_of(store)
    first = {int(ray): carrier for carrier, which in block.departures() for ray in which}
    block.rays["t"] = 0.0
    block.rays["id"] = 5
    again = [ray for _, which in block.departures() for ray in which]
    inside = entries(block.rays, boxes_of(store, store.manifest.shards)) == 0.0
    assert 600 < len(first) <= len(block.rays)
    assert len(again) == (inside.sum(axis=1) > 1).sum()  # the nearest begins where they do


def test_entries_are_those_of_the_plain_rule():
    rays_here = np.zeros(6, QUERY_RAY)
    rays_here["ox"] = [-5, 5, -5, 0, -5, 0]
    rays_here["dx"] = [1, 1, -1, 0, 0, 0]
    rays_here["oy"] = [0, 0, 0, 0, 1, 3]
    rays_here["dy"] = [0, 0, 0, 1, 0, -0.5]
    box = np.array([[[-1.0, -1.0, -1.0], [1.0, 1.0, 1.0]], [[np.inf] * 3, [-np.inf] * 3]])
    found = entries(rays_here, box)
    np.testing.assert_array_equal(found[:, 0], [4, np.inf, np.inf, 0, np.inf, 4])
    np.testing.assert_array_equal(found[:, 1], np.inf)


@pytest.mark.parametrize("same", [False, True])
def test_cargo_is_what_was_sent(same):
    records = np.frombuffer(np.random.default_rng(1).bytes(5000 * 88), QUERY_RAY)
    if same:
        records = np.full(5000, records[0])
    cargo = Cargo.of(records)
    assert cargo.records(QUERY_RAY).tobytes() == records.tobytes()
    assert cargo.packed == same
    assert len(cargo) <= records.nbytes
    assert len(Cargo.of(records[:0]).records(QUERY_RAY)) == 0


def test_shards_are_shared_out_by_their_objects(scenes):
    path = os.fspath(scenes["given"].sharded.path)
    manifest = scenes["given"].sharded.store.manifest
    sight = seen(path)
    assert sight == Sight((0, 1, 2, 3), "", ((),) * 4)
    carriers = shared_out(manifest, {"a": sight, "b": sight})
    assert sorted(n for each in carriers for n in each.numbers) == [0, 1, 2, 3]
    loads = [sum(manifest.shards[n].objects for n in each.numbers) for each in carriers]
    assert max(loads) < 2 * min(loads)
    assert [each.workers for each in carriers] == [("a", "b"), ("b", "a")]


def test_shards_stay_where_they_are_seen(scenes):
    manifest = scenes["given"].sharded.store.manifest
    sights = {"a": Sight((0, 3), "p: no"), "b": Sight((1, 2), "q: no")}
    carriers = shared_out(manifest, sights)
    assert {each.workers: each.numbers for each in carriers} == {("a",): (0, 3), ("b",): (1, 2)}
    with pytest.raises(StoreError, match=r"^a: shard \d cannot be opened: p: no"):
        shared_out(manifest, {"a": sights["a"]})
    with pytest.raises(SettingError, match=r"^client: found no worker, expected one or more"):
        shared_out(manifest, {})


def test_another_scene_under_the_same_name(scenes):
    place = ShardPlace(os.fspath(scenes["given"].sharded.path), 1, (0,))
    with pytest.raises(StoreError, match=r"found the scene .*, expected 00000001"):
        place.open()
