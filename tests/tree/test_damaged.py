"""Treelets that are damaged are refused, or give some answer: never a crash, never no end."""

from __future__ import annotations

import shutil
from dataclasses import replace

import numpy as np
import pytest
from injected import dividing
from scenes import random_objects, random_rays
from treelets import FORMS, QUERIES, answers, formed, pair, same

import bfrt
from bfrt.errors import ShortReadError, StoreError, StreamError
from bfrt.records import NODE, TREELET, Kind
from bfrt.scene import Scene
from bfrt.store.model import Camera
from bfrt.store.store import open_store
from bfrt.tree.reading import DEEPEST_NODE

VIEW = Camera((0.1, -9.0, 1.0), (0.0, 0.0, 0.0), resolution=(12, 12))
PARTS = ("nodes", "treelets", "offsets", "ids", "geometry")
NUMBERS = (0, 1, 2, 3, 255, 1 << 16, (1 << 31) - 1, 1 << 31, (1 << 32) - 1)


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    """A store of every kind in small treelets, not to be changed, and rays."""
    rng = np.random.default_rng(61)
    objects = random_objects(rng, 600, spread=4.0)
    store = pair(objects, tmp_path_factory.mktemp("whole"), np.float32)[1]
    some = random_rays(rng, objects, 6).values()
    return store, *(np.concatenate(each) for each in zip(*some, strict=True))


@pytest.fixture
def damaged(whole, tmp_path):
    """A copy of it, to be damaged, and rays."""
    path = shutil.copytree(whole[0].path, tmp_path / "a.bfrt")
    return open_store(path), *whole[1:]


def damage(rng, store):
    """Change bytes, whole numbers or records of one file."""
    part = str(rng.choice(PARTS))
    streams = [s for s in store.streams if part in s.files]
    stream = streams[rng.integers(len(streams))]
    path = stream.path(part)
    data = np.fromfile(path, np.uint8)
    way = rng.integers(4)
    if way == 0:
        data[rng.integers(len(data), size=rng.integers(1, 9))] ^= np.uint8(1 << rng.integers(8))
    elif way == 1:
        words = data[: len(data) // 4 * 4].view(np.uint32)
        words[rng.integers(len(words), size=rng.integers(1, 4))] = rng.choice(NUMBERS)
    elif way == 2 and part in ("nodes", "treelets"):
        records = data.view(NODE if part == "nodes" else TREELET)
        names = ("child", "first", "inner") if part == "nodes" else ("first", "node", "count")
        name = str(rng.choice(names))
        records[name][rng.integers(len(records))] = rng.integers(
            0, np.iinfo(records.dtype[name]).max, dtype=np.uint64
        )
    else:
        begin, size = rng.integers(len(data)), rng.integers(1, 200)
        data[begin : begin + size] = rng.integers(256, size=len(data[begin : begin + size]))
    data.tofile(path)
    return part


def survives(store, rays, form):
    """Ask everything, and count what is refused."""
    refused = 0
    with formed(store, form) as scene:
        for query in QUERIES:
            try:
                getattr(scene, query)(*rays, threads=2, refine="tree")
            except bfrt.BfrtError as error:
                assert str(store.path) in str(error)
                refused += 1
        try:
            scene.render(camera=VIEW, threads=2, refine="tree")
        except bfrt.BfrtError:
            refused += 1
    return refused


@pytest.mark.parametrize("seed", range(24))
def test_any_damage_is_survived(damaged, seed):
    store, *rays = damaged
    damage(np.random.default_rng([62, seed]), store)
    for form in ("resident", "streamed"):
        survives(store, rays, form)
