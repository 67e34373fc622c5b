"""Treelets that are damaged are refused, or give some answer: never a crash, never no end."""

from __future__ import annotations

import shutil

import numpy as np
import pytest
from scenes import random_objects, random_rays
from treelets import FORMS, QUERIES, answers, formed, pair, same, small_treelets

import bfrt
from bfrt.errors import ShortReadError, StoreError, StreamError
from bfrt.records import NODE, TREELET, Kind
from bfrt.scene import Scene
from bfrt.store.model import Camera
from bfrt.store.store import open_store
from bfrt.streams.runs import RunReader
from bfrt.tree.pieces import NODES_READ, RECORDS_READ
from bfrt.tree.reading import DEEPEST_NODE

VIEW = Camera((0.1, -9.0, 1.0), (0.0, 0.0, 0.0), resolution=(12, 12))
PARTS = ("nodes", "treelets", "offsets", "ids", "geometry")
NUMBERS = (0, 1, 2, 3, 255, 1 << 16, (1 << 31) - 1, 1 << 31, (1 << 32) - 1)


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    """A store of every kind in small treelets, not to be changed, and rays."""
    rng = np.random.default_rng(61)
    objects = random_objects(rng, 600, spread=4.0)
    store = pair(objects, tmp_path_factory.mktemp("whole"), np.float32, treelets=(64, 2))[1]
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


@pytest.mark.parametrize("seed", range(12))
def test_any_damage_is_survived(damaged, seed):
    store, *rays = damaged
    damage(np.random.default_rng([62, seed]), store)
    for form in ("resident", "streamed", "streamed past the cache"):
        survives(store, rays, form)


def rewritten(store, part, change, kind=Kind.POLYGON):
    """Change records of a file of one stream."""
    (stream,) = (s for s in store.streams if s.kind == kind)
    dtype = {"nodes": NODE, "treelets": TREELET, "offsets": "<u4"}[part]
    records = np.fromfile(stream.path(part), dtype)
    change(records)
    records.tofile(stream.path(part))


def without_objects(treelets):
    treelets["count"][1] += treelets["count"][0]
    treelets["count"][0], treelets["first"][1] = 0, 0


def without_nodes(treelets):
    treelets["nodes"][1] += treelets["nodes"][0]
    treelets["nodes"][0], treelets["node"][1] = 0, 0


def overlapping(treelets):
    treelets["first"][1] -= 1


def beyond(treelets):
    treelets["count"][-1] += 1


def wrapped(treelets):
    treelets["first"][1] = 2**64 - 1


def turned(treelets):
    treelets["lox"][0] = treelets["hix"][0] + 1


def unbounded(treelets):
    treelets["hiy"][0] = np.inf


def empty_treelets(treelets):
    treelets["loz"][0] = np.nan


@pytest.mark.parametrize(
    "change",
    [without_objects, without_nodes, overlapping, beyond, wrapped, turned, unbounded,
     empty_treelets],
)  # fmt: skip
@pytest.mark.parametrize("form", ["resident", "streamed", "streamed past the cache"])
def test_a_table_of_treelets_that_lies_is_refused(damaged, change, form):
    store, *rays = damaged
    rewritten(store, "treelets", change)
    assert survives(store, rays, form) == len(QUERIES) + 1
    with pytest.raises(StoreError, match="found treelets that do not follow one another"):
        formed(store, form).cast_rays(*rays, refine="tree")


def in_a_circle(nodes):
    nodes["child"][nodes["inner"] != 0] = 0


def beside(nodes):
    nodes["child"] += np.uint32(1)


def first_beyond(nodes):
    nodes["first"][:] = 1 << 31


def larger_leaves(nodes):
    nodes["count"][nodes["count"] < 255] += 200


def no_leaves(nodes):
    nodes["count"][:], nodes["inner"][:] = 255, 255


def other_leaves(nodes):
    nodes["inner"] ^= np.uint8(255)


@pytest.mark.parametrize(
    "change", [in_a_circle, beside, first_beyond, larger_leaves, no_leaves, other_leaves]
)
@pytest.mark.parametrize("kind", [Kind.TRIANGLE, Kind.POLYGON], ids=["triangles", "polygons"])
@pytest.mark.parametrize("form", ["resident", "streamed", "streamed past the cache"])
def test_nodes_that_are_no_tree_are_refused(damaged, change, kind, form):
    store, *rays = damaged
    rewritten(store, "nodes", change, kind)
    with pytest.raises(StoreError, match="found nodes that are no tree of their treelet"):
        formed(store, form).cast_rays(*rays, refine="tree", threads=2)
    survives(store, rays, form)


@pytest.mark.parametrize("form", ["resident", "streamed", "streamed past the cache"])
def test_a_tree_of_too_many_levels_is_refused(tmp_path, form):
    """A chain of nodes with one child each."""
    with bfrt.SceneWriter(tmp_path / "a", order="spatial") as writer:
        writer.spheres(np.random.default_rng(0).uniform(-1, 1, (900, 3)), 0.1)
    store = open_store(tmp_path / "a")

    def chain(nodes):
        n = np.arange(len(nodes))
        nodes["inner"], nodes["count"], nodes["first"] = 1, 0, 0
        nodes["child"], nodes["count"][:, 0] = n + 1, 255
        nodes["inner"][-1] = nodes["count"][-1, 0] = 0
        assert len(nodes) > DEEPEST_NODE

    rewritten(store, "nodes", chain, Kind.SPHERE)
    with pytest.raises(StoreError, match="found nodes that are no tree of their treelet"):
        formed(store, form).cast_rays([[0.0, 0, -3]], [[0.0, 0, 1]], refine="tree")


def test_ends_of_polygons_that_descend_are_refused(damaged):
    store, *rays = damaged

    def descending(ends):
        ends[20:60] = ends[20:60][::-1].copy()

    rewritten(store, "offsets", descending)
    for form in ("resident", "streamed", "streamed past the cache"):
        with pytest.raises(StoreError, match="found an end at vertex"):
            formed(store, form).cast_rays(*rays, refine="tree")


def test_a_treelet_of_more_vertices_than_there_is_memory_for_is_refused(tmp_path):
    """An end that is damaged makes a treelet of all vertices, of which the header tells less."""
    turn = np.linspace(0, 2 * np.pi, 3000, endpoint=False)
    outline = np.column_stack([np.cos(turn), np.sin(turn), 0 * turn])
    corners = np.concatenate([np.add(outline, (0, 0, k)) for k in range(80)])
    with small_treelets(), bfrt.SceneWriter(tmp_path / "a", order="spatial") as writer:
        writer.polygons(corners, np.full(80, 3000))
    store = open_store(tmp_path / "a")
    (stream,) = store.streams
    first = int(np.fromfile(stream.path("treelets"), TREELET)["count"][0])
    assert stream.vertices * stream.stride > RECORDS_READ > RunReader.room(stream.treelet_bytes)

    def all_in_one(ends):
        ends[first - 1 :] = stream.vertices

    rewritten(store, "offsets", all_in_one)
    rays = np.tile([0.0, 0, -3], (50, 1)), np.tile([0.0, 0, 1], (50, 1))
    for form in ("streamed", "streamed past the cache"):
        with pytest.raises(StoreError, match="geometry: found a treelet of more bytes than"):
            formed(store, form).cast_rays(*rays, refine="tree")


def test_a_table_with_a_treelet_of_more_nodes_than_there_is_memory_for_is_refused(tmp_path):
    rng = np.random.default_rng(0)
    with bfrt.SceneWriter(tmp_path / "a", order="spatial") as writer:
        writer.spheres(rng.uniform(-1, 1, (150_000, 3)), 0.01)
    store = open_store(tmp_path / "a")
    (stream,) = store.streams
    assert stream.nodes * NODE.itemsize > NODES_READ > RunReader.room(stream.treelet_bytes)
    table = np.fromfile(stream.path("treelets"), TREELET)
    low, high = ([table[f"{side}{axis}"][0] for axis in "xyz"] for side in ("lo", "hi"))

    def nearly_all_in_one(treelets):
        treelets["node"][1:] = stream.nodes - len(treelets) + np.arange(1, len(treelets))
        treelets["nodes"][1:], treelets["nodes"][0] = 1, treelets["node"][1]

    rewritten(store, "treelets", nearly_all_in_one, Kind.SPHERE)
    for form in ("streamed", "streamed past the cache"):
        with pytest.raises(StoreError, match="nodes: found a treelet of more bytes than"):
            scene = formed(store, form)  # of several threads another may tell of its own treelet
            scene.cast_rays([np.mean([low, high], 0)], [[0.0, 0, 1]], refine="tree", threads=1)


@pytest.mark.parametrize("part", PARTS)
def test_a_truncated_file_is_refused_at_open(damaged, part):
    store = damaged[0]
    path = next(s.path(part) for s in store.streams if part in s.files)
    data = path.read_bytes()
    for wrong in (data[:-1], data[: len(data) // 2], b"", data + b"x"):
        path.write_bytes(wrong)
        with pytest.raises(StoreError, match=f"{part}: found {len(wrong)} bytes, expected"):
            bfrt.open(store.path)
    path.write_bytes(data)
    broken = bytearray(data)
    broken[len(data) // 3] ^= 4
    path.write_bytes(broken)
    with pytest.raises(StoreError, match="the contents differ from what was written"):
        bfrt.open(store.path).verify()
    path.unlink()
    with pytest.raises(StoreError, match=f"{part}: the file is missing"):
        bfrt.open(store.path)


@pytest.mark.parametrize("threads", [1, 3])
@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize("part", ["nodes", "geometry", "offsets", "ids"])
def test_a_read_that_fails_is_one_error_and_the_next_query_works(damaged, part, form, threads):
    """The file is shorter than it was when the store was opened; then it is whole again."""
    store, *rays = damaged
    scene = formed(store, form)
    expected = answers(scene, *rays, threads=threads)
    path = next(s.path(part) for s in store.streams if part in s.files)
    data = path.read_bytes()
    for size in (0, len(data) // 2):
        scene.close()
        path.write_bytes(data[:size])
        with pytest.raises((ShortReadError, StoreError)) as caught:
            scene.cast_rays(*rays, threads=threads)
        assert str(caught.value).startswith(f"{path}: ")
        with pytest.raises((ShortReadError, StoreError)):
            scene.render(camera=VIEW, threads=threads)
        path.write_bytes(data)
        same(expected, answers(scene, *rays, threads=threads))


@pytest.mark.parametrize("form", ["resident", "streamed", "streamed past the cache"])
def test_a_system_that_refuses_reads(damaged, form, monkeypatch):
    """Linux fails reads of the first page of a process's memory with EIO."""
    store, *rays = damaged
    scene = formed(store, form)
    expected = answers(scene, *rays)
    scene.close()
    path = next(s.path("nodes") for s in store.streams if s.kind == Kind.TRIANGLE)
    kept = path.rename(path.with_suffix(".kept"))
    path.symlink_to("/proc/self/mem")
    try:
        path.open("rb").close()
    except OSError:
        pytest.skip("no /proc/self/mem here")
    monkeypatch.setattr("bfrt.store.folder.check_size", lambda *_: None)  # it says it is empty
    with pytest.raises(StreamError) as caught:
        for query in QUERIES:
            getattr(scene, query)(*rays)
    assert str(caught.value).startswith(f"{path}: ")
    path.unlink()
    kept.rename(path)
    same(expected, answers(scene, *rays))


def test_a_file_that_is_gone_by_now(damaged):
    store, *rays = damaged
    scene = Scene(store)
    for part in ("nodes", "treelets", "ids"):
        path = store.streams[0].path(part)
        kept = path.rename(path.with_suffix(".kept"))
        with pytest.raises(StoreError) as caught:
            scene.cast_rays(*rays)
        assert str(caught.value) == f"{path}: the file is missing"
        kept.rename(path)
    assert np.isfinite(scene.cast_rays(*rays)["t_hit"]).any()
