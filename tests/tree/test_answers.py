"""What rays meet by treelets is what they meet by a grid, and by brute force, bit for bit."""

from __future__ import annotations

from contextlib import nullcontext

import fast
import numpy as np
import pytest
from scenes import hard_scenes, joined, random_objects, random_rays, twice, units
from treelets import FORMS, QUERIES, answers, formed, pair, plain_vectors, same, small_treelets

import bfrt
from bfrt import tree_tracer
from bfrt.errors import SettingError
from bfrt.records import INDEX_BITS, NO_HIT, Kind
from bfrt.reference import exhaustive
from bfrt.reference.independent import Objects
from bfrt.scene import Scene
from bfrt.store.ordering import objects as objects_module

NAMES = sorted(hard_scenes(np.random.default_rng(0)))

#: Forms, threads, and whether vectors are plain.
WAYS = [
    ("resident", 1, False),
    ("resident", 3, True),
    ("resident, few rays", 2, False),
    ("streamed", 1, True),
    ("streamed", 2, False),
    ("streamed past the cache", 2, False),
    ("streamed, few rays", 3, False),
]


def rays_at(rng, objects, n):
    """Rays of every sort, `n` of each, and some that are none."""
    sorts = random_rays(rng, objects, n).values()
    origins, directions = (np.concatenate(some) for some in zip(*sorts, strict=True))
    origins[3, 1], directions[5], directions[7, 2] = np.nan, 0.0, np.inf
    return origins, directions


def hold(stores, rays, ways=WAYS, **settings):
    """Hold what treelets answer, in every way, to a grid's answers; return these."""
    given, ordered = stores
    expected = answers(Scene(given), *rays, refine="sgb", **settings)
    for form, threads, plain in ways:
        with plain_vectors() if plain else nullcontext(), formed(ordered, form) as scene:
            found = answers(scene, *rays, threads=threads, refine="tree", **settings)
            same(expected, found, f"{form}, {threads} threads, plain {plain}")
    return expected


def brute_force(store, answered, origins, directions):
    """Hold answers to those of all rays against all objects."""
    own = origins - np.array(store.origin)
    t, ids = exhaustive.nearest(store, own, directions)
    np.testing.assert_array_equal(answered["cast_rays t_hit"], t)
    found = answered["cast_rays geometry_ids"].astype(np.uint64) << np.uint64(INDEX_BITS)
    found |= answered["cast_rays primitive_ids"].astype(np.uint64)
    np.testing.assert_array_equal(np.where(np.isinf(t), np.uint64(NO_HIT), found), ids)
    np.testing.assert_array_equal(answered["occluded occluded"], np.isfinite(t))
    ray, t, ids = exhaustive.crossings(store, own, directions)
    np.testing.assert_array_equal(answered["list_intersections ray_ids"], ray)
    np.testing.assert_array_equal(answered["list_intersections t_hit"], t)
    counts = np.bincount(ray, minlength=len(origins))
    np.testing.assert_array_equal(answered["count_intersections counts"], counts)


@pytest.mark.parametrize("dtype", [np.float32, np.float64], ids=["float32", "float64"])
@pytest.mark.parametrize("name", NAMES)
def test_hard_scenes(tmp_path, name, dtype):
    rng = np.random.default_rng([41, NAMES.index(name)])
    objects = hard_scenes(rng)[name]
    stores = pair(objects, tmp_path, dtype)
    rays = rays_at(rng, objects, 4 if name == "overlapping" else 15)
    good = np.isfinite(rays[0]).all(1) & np.isfinite(rays[1]).all(1) & rays[1].any(1)
    expected = hold(stores, rays)
    answered = answers(Scene(stores[1]), *(some[good] for some in rays))
    for store in stores:
        brute_force(store, answered, rays[0][good], rays[1][good])
    if len(objects):
        assert np.isfinite(expected["cast_rays t_hit"]).any()


@pytest.mark.parametrize("seed", range(8))
def test_random_scenes(tmp_path, seed):
    """Of any number of objects, treelets of any size, an origin of the store's own."""
    rng = np.random.default_rng([42, seed])
    objects = random_objects(
        rng, int(rng.integers(1, 3000)), size=float(rng.choice([0.1, 0.5, 3.0]))
    )
    leaf = int(rng.integers(1, 5))
    most = int(rng.choice([leaf, 7, 64, 1024]))
    origin = rng.uniform(-1e4, 1e4, 3) if seed % 2 else None
    stores = pair(objects, tmp_path, origin=origin, treelets=(max(most, leaf), leaf))
    rays = rays_at(rng, objects, 25)
    begin, end = rng.uniform(-1, 3, len(rays[0])), rng.uniform(0, 9, len(rays[0]))
    begin[rng.random(len(begin)) < 0.5] = 0.0
    end[rng.random(len(end)) < 0.3] = np.inf
    hold(stores, rays, [WAYS[seed % 3], WAYS[3 + seed % 3]], t_min=begin, t_max=end)


def test_rays_of_any_length_and_from_anywhere(tmp_path):
    rng = np.random.default_rng(43)
    objects = random_objects(rng, 500)
    stores = pair(objects, tmp_path)
    directions = units(rng, 800)
    at = rng.uniform(-5, 5, (800, 3))
    away = 10.0 ** rng.integers(0, 40, (800, 1))
    origins = at - away * directions
    directions *= 10.0 ** rng.choice([-300, -100, -30, 0, 30, 100, 250], (800, 1))
    hold(stores, (origins, directions), [WAYS[0], WAYS[4]])


@pytest.mark.parametrize("groups", [2, 5])
def test_groups_of_one_store(tmp_path, groups):
    rng = np.random.default_rng(groups)
    objects = fast.stored(random_objects(rng, 900, spread=5.0))
    stores = []
    for order in ("given", "spatial"):
        path = tmp_path / order
        with small_treelets(), bfrt.SceneWriter(path, dtype="f8", order=order) as writer:
            for group in range(groups):
                writer.append(Kind.SPHERE, objects.spheres[group::groups], group=group)
                writer.append(Kind.TRIANGLE, objects.triangles[group::groups], group=group)
        stores.append(bfrt.open(path).store)
    assert len(stores[1].streams) == 2 * groups
    rays = rays_at(rng, objects, 20)
    expected = hold(stores, rays)
    assert len(np.unique(expected["cast_rays geometry_ids"])) == 2 * groups + 1


def test_ids_of_eight_bytes(tmp_path, monkeypatch):
    """As of more than 2^32 objects."""
    monkeypatch.setattr(objects_module, "SHORT_IDS", 10)
    rng = np.random.default_rng(48)
    objects = random_objects(rng, 600)
    stores = pair(twice(objects), tmp_path)
    assert {stream.id_bytes for stream in stores[1].streams} == {8}
    hold(stores, rays_at(rng, objects, 10))


def test_thousands_at_one_place(tmp_path):
    """Of those that are met together the first given is hit; all of them are counted."""
    rng = np.random.default_rng(44)
    corners = np.repeat(rng.uniform(-1, 1, (1, 9)), 1300, axis=0)
    balls = np.repeat([[3.0, 0.0, 0.0, 1.0]], 1100, axis=0)
    some = random_objects(rng, 100, [Kind.TRIANGLE, Kind.SPHERE])
    crowd = joined(some, Objects(triangles=corners, spheres=balls), some)
    middle = corners[0].reshape(3, 3).mean(axis=0)
    origins = np.concatenate([middle + 4 * units(rng, 6), [3.0, 0.0, 0.0] + 4 * units(rng, 6)])
    targets = np.concatenate([np.tile(middle, (6, 1)), np.tile([3.0, 0.1, 0.1], (6, 1))])
    for sizes in ((16, 4), (1024, 4)):
        folder = tmp_path / str(sizes[0])
        folder.mkdir()
        stores = pair(crowd, folder, treelets=sizes)
        expected = hold(stores, (origins, targets - origins), [WAYS[1], WAYS[4], WAYS[5]])
        assert (expected["count_intersections counts"][6:] >= 2200).all()
        firsts = len(some.triangles), len(some.spheres)
        assert set(firsts) <= set(expected["cast_rays primitive_ids"].tolist())


def test_shared_edges_and_vertices_have_no_cracks(tmp_path):
    """Rays at the vertices and edges of a closed surface: in by one face, out by another."""
    rng = np.random.default_rng(45)
    n = 24
    u, v = np.meshgrid(np.arange(n + 1) * 2 * np.pi / n, np.arange(n + 1) * np.pi / n)
    u[:, -1] = u[:, 0]
    radius = 2 + np.where((v == 0) | (v == v[-1, 0]), 0.0, np.sin(5 * u) * np.sin(v) * 0.3)
    points = radius[..., None] * np.stack(
        [np.sin(v) * np.cos(u), np.sin(v) * np.sin(u), np.cos(v)], -1
    )
    points[0], points[-1] = [0, 0, 2], [0, 0, -2]
    a, b, c, d = points[:-1, :-1], points[1:, :-1], points[1:, 1:], points[:-1, 1:]
    faces = np.concatenate([np.stack([a, b, c], -2), np.stack([a, c, d], -2)]).reshape(-1, 9)
    stores = pair(Objects(triangles=faces), tmp_path, np.float32)
    corners = fast.stored(Objects(triangles=faces), np.float32).triangles.reshape(-1, 3, 3)
    at = np.concatenate([corners[::5, 0], (corners[::7, 0] + corners[::7, 1]) / 2])
    inside = rng.uniform(-0.2, 0.2, at.shape)
    expected = hold(stores, (inside, at - inside), [WAYS[0], WAYS[3], WAYS[5]])
    assert (expected["count_intersections counts"] == 1).all()
    assert expected["occluded occluded"].all()


@pytest.fixture
def scene(tmp_path):
    rng = np.random.default_rng(46)
    objects = random_objects(rng, 700)
    stores = pair(objects, tmp_path)
    return stores[1], *rays_at(rng, objects, 10)


@pytest.mark.parametrize("form", FORMS)
def test_arrays_folders_and_blocks_get_the_same(scene, tmp_path, form):
    store, origins, directions = scene
    opened = formed(store, form)
    expected = answers(opened, origins, directions)
    for query in QUERIES:
        ask = getattr(opened, query)
        blocks = ((origins[i : i + 17], directions[i : i + 17]) for i in range(0, 150, 17))
        found = dict(ask(blocks))
        folder = dict(ask(origins, directions, out=tmp_path / f"{form} {query}"))
        assert all(isinstance(values, np.memmap) for values in folder.values())
        wanted = {k.split()[1]: v for k, v in expected.items() if k.split()[0] == query}
        same(wanted, found)
        same(wanted, {key: np.asarray(values) for key, values in folder.items()})
        if query == "list_intersections":
            with pytest.raises(SettingError, match="out: found arrays, expected a folder"):
                ask(origins, directions, out={})
            continue
        key = next(iter(wanted))
        filled = {key: np.empty_like(wanted[key])}
        assert ask(origins, directions, out=filled)[key] is filled[key]
        same({key: wanted[key]}, filled)


@pytest.mark.parametrize("form", FORMS)
def test_bad_rays_are_counted_the_same(scene, form, caplog):
    store, origins, directions = scene
    end = np.full(len(origins), np.inf)
    end[2], end[11] = np.nan, -1.0  # the last is no bad ray, though it meets nothing
    for query in QUERIES:
        ask = getattr(formed(store, form), query)
        for settings in ({}, {"threads": 3}, {"refine": "sgb"}):
            assert ask(origins, directions, t_max=end, **settings).stats.bad_rays == 4
    assert "4 rays were NaN" in caplog.text


@pytest.mark.parametrize("form", FORMS)
def test_no_rays_and_no_objects(tmp_path, scene, form):
    store = scene[0]
    none = np.empty((0, 3))
    same(
        answers(formed(store, form), none, none),
        answers(Scene(store), none, none, refine="sgb"),
    )
    with bfrt.SceneWriter(tmp_path / "empty", order="spatial") as writer:
        writer.spheres(none, 1.0)
    empty = formed(bfrt.open(tmp_path / "empty"), form)
    found = answers(empty, np.zeros((3, 3)), np.ones((3, 3)), refine="tree")
    assert (found["cast_rays primitive_ids"] == -1).all()
    assert (found["count_intersections counts"] == 0).all()
    same(found, answers(empty, np.zeros((3, 3)), np.ones((3, 3)), refine="tree", threads=3))


def test_every_budget_from_the_least_up(tmp_path):
    rng = np.random.default_rng(47)
    objects = random_objects(rng, 4000)
    given, ordered = pair(objects, tmp_path)
    rays = rays_at(rng, objects, 400)
    expected = answers(Scene(given), *rays)
    for memory in ("66MiB", "68MiB", "80MiB", "256MiB", "1GiB"):
        for form in ("resident", "streamed"):
            with formed(ordered, form) as scene:
                same(expected, answers(scene, *rays, memory=memory, threads=1), memory)


@pytest.mark.slow
def test_threads_that_come_upon_one_ray_at_once(tmp_path, monkeypatch):
    """Few rays through many treelets that overlap: what one thread reads another changes."""
    monkeypatch.setattr(tree_tracer, "TREELETS_AT_ONCE", 1)
    rng = np.random.default_rng(5)
    objects = random_objects(rng, 1500, [Kind.SPHERE], spread=1.0, size=3.0)
    given, ordered = pair(objects, tmp_path, treelets=(1, 1))
    origins = units(rng, 400) * 6
    directions = rng.uniform(-0.3, 0.3, (400, 3)) - origins
    expected = Scene(given).cast_rays(origins, directions)
    with formed(ordered, "streamed") as scene:
        for _ in range(6000):
            same(expected, scene.cast_rays(origins, directions, threads=2))
