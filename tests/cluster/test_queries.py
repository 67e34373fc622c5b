"""Queries of dask arrays answer what queries of arrays do, when they are computed."""

from __future__ import annotations

import pickle
import re

import numpy as np
import pytest
from cluster_fixtures import MEMORY, NEEDED, assert_same_answer, some_rays

import bfrt
from bfrt.cluster import blocks
from bfrt.cluster.counters import ClusterStats
from bfrt.cluster.lazy_answer import LazyAnswer
from bfrt.errors import SettingError

pytest.importorskip("distributed", reason=NEEDED)
import dask
import dask.array as da

QUERIES = ("cast_rays", "occluded", "count_intersections", "list_intersections")
WAYS = {"base": "given", "sgb": "given", "tree": "spatial"}
RAYS = 1000
BLOCK = 300


@pytest.fixture(params=WAYS)
def asked(request, paths):
    """A scene, and settings for it."""
    with bfrt.open(paths[WAYS[request.param]]) as scene:
        yield scene, {"refine": request.param, "memory": MEMORY}


@pytest.fixture
def one(paths):
    """A scene, where any way will do."""
    with bfrt.open(paths["spatial"]) as scene:
        yield scene


@pytest.fixture(scope="module")
def rays():
    return some_rays(RAYS)


def in_blocks(array, rows=BLOCK):
    return da.from_array(array, chunks=(rows, *array.shape[1:]))


@pytest.fixture(scope="module")
def lazy(rays):
    return tuple(map(in_blocks, rays))


@pytest.fixture(autouse=True)
def scheduler():
    """Dask's threads, where no test says otherwise, whatever client there is."""
    with dask.config.set(scheduler="threads"):
        yield


# --- answers -------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", QUERIES)
def test_the_answer_is_the_same(shared_client, asked, rays, lazy, name):
    scene, settings = asked
    expected = getattr(scene, name)(*rays, **settings)
    answer = getattr(scene, name)(*lazy, **settings)
    with dask.config.set(scheduler=shared_client):
        found = answer.compute()
    assert type(found) is bfrt.Answer
    assert_same_answer(found, expected)
    for key, array in answer.items():
        assert isinstance(array, da.Array) and array.dtype == expected[key].dtype
        assert array._meta.dtype == array.dtype and array.ndim == expected[key].ndim
        assert array.numblocks[0] == 4 + (key == "ray_splits")
    assert found.stats.total.rays == expected.stats.total.rays
    assert found.stats.total.object_tests == sum(
        w.total.object_tests for w in found.stats.workers.values()
    )


@pytest.mark.parametrize("name", QUERIES)
def test_rays_of_other_shapes(asked, rays, name):
    """Rows of six, maps, and one for all."""
    scene, settings = asked
    query = getattr(scene, name)
    o, d = (np.asarray(part[:900]).reshape(30, 30, 3) for part in rays)
    six = np.concatenate([o, d], axis=-1)
    t_max = np.linspace(0.5, 2.0, 900).reshape(30, 30)
    for given, plain in (
        ((in_blocks(six, 7), None, 0.0, in_blocks(t_max, 4)), (six, None, 0.0, t_max)),
        ((in_blocks(o, 7), d, 0.0, t_max), (o, d, 0.0, t_max)),
        ((in_blocks(six.reshape(900, 6)),), (six.reshape(900, 6),)),
        ((da.from_array(o, chunks=(9, 4, 2)), in_blocks(d, 4)), (o, d)),
        (([*o[0, 0]], in_blocks(d, 7)), (o[0, 0], d)),
        ((in_blocks(o.reshape(900, 3)), d[0, 0]), (o.reshape(900, 3), d[0, 0])),
    ):
        answer = query(*given, **settings)
        assert_same_answer(answer.compute(), query(*plain, **settings))
        for key, array in query(*plain, **settings).items():
            known = not np.isnan(answer[key].shape[0])
            assert answer[key].shape == array.shape if known else name == "list_intersections"


@pytest.mark.parametrize("name", ["visibility", "visibility of all sides", "contains"])
def test_points(shared_client, asked, rays, name):
    """By their numbers through all blocks."""
    scene, settings = asked
    points, normals = (np.asarray(part[:900]) for part in rays)
    maps = [part.reshape(30, 30, 3) for part in (points, normals)]
    if name == "visibility":
        forms = [
            ((in_blocks(points), normals), (points, normals)),
            ((points, in_blocks(normals)), (points, normals)),
            ((in_blocks(points), (0, 0, 1.0)), (points, (0, 0, 1.0))),
            ((in_blocks(maps[0], 7), in_blocks(maps[1], 4)), maps),
        ]
    else:
        forms = [((in_blocks(points),), (points,)), ((in_blocks(maps[0], 7),), maps[:1])]
    query = getattr(scene, name.split()[0])
    for given, plain in forms:
        expected = query(*plain, **settings)
        answer = query(*given, **settings)
        with dask.config.set(scheduler=shared_client):
            found = answer.compute()
        for key, values in expected.items():
            assert answer[key].shape == values.shape and answer[key].dtype == values.dtype
            np.testing.assert_array_equal(found[key], values)
            assert len(np.unique(values)) > 1 or name == "contains"
        assert found.stats.unsure_points == expected.stats.unsure_points
        assert found.stats.total.rays == expected.stats.total.rays


def test_where_hits_are(shared_client, asked, rays, lazy):
    scene, settings = asked
    wanted = {"outputs": ["next_origins", "positions"], "side": "back"}
    answer = scene.cast_rays(*lazy, **wanted, **settings)
    assert answer["positions"].shape == answer["next_origins"].shape == (RAYS, 3)
    with dask.config.set(scheduler=shared_client):
        found = answer.compute()
    assert_same_answer(found, scene.cast_rays(*rays, **wanted, **settings))
    other = scene.cast_rays(*lazy, outputs=["positions"], **settings)
    assert "next_origins" not in other
    assert other["positions"].name != answer["positions"].name


@pytest.mark.parametrize(
    ("given", "settings", "said"),
    [
        ((da.zeros((4, 2)),), {}, "points: found float64 of shape (4, 2), expected"),
        ((da.zeros((4, 3)), da.zeros((5, 3))), {}, "normals: found shape (5, 3) in 1 blocks"),
        (((1.0, 2.0, 3.0), da.zeros((5, 3))), {}, "points: found one with dask arrays of normals"),
        ((da.zeros((4, 3)),), {"out": "folder"}, "out: found one with dask arrays"),
        ((da.zeros((4, 3)),), {"rays": 0}, "rays: found 0, expected a whole number"),
        ((da.zeros((4, 3))[da.zeros(4) == 0],), {}, "points: found blocks of unknown size"),
    ],
)
def test_points_that_are_refused(one, given, settings, said):
    with pytest.raises(SettingError, match=re.escape(said)):
        one.visibility(*given, **settings)


def test_sizes_are_known_where_they_can_be(one, lazy):
    sizes = (300, 300, 300, 100)
    hits = one.cast_rays(*lazy)
    assert hits["t_hit"].chunks == (sizes,)
    assert hits["primitive_normals"].chunks == (sizes, (3,))
    assert hits["primitive_uvs"].chunks == (sizes, (2,))
    every = one.list_intersections(*lazy)
    assert every["ray_splits"].shape == (RAYS + 1,)
    assert np.isnan(every["t_hit"].shape[0]) and every["primitive_normals"].shape[1] == 3


@pytest.mark.parametrize("workers", ["threads", "synchronous"])
@pytest.mark.parametrize("name", QUERIES)
def test_without_a_cluster(one, rays, lazy, name, workers):
    """Whatever scheduler computes them; blocks of one process come one after another."""
    expected = getattr(one, name)(*rays, memory=MEMORY)
    with dask.config.set(scheduler=workers):
        assert_same_answer(getattr(one, name)(*lazy, memory=MEMORY).compute(), expected)


def test_a_function_that_takes_a_path(one, rays, lazy):
    found = bfrt.cast_rays(one.path, *lazy, memory=MEMORY)
    assert_same_answer(found.compute(), one.cast_rays(*rays, memory=MEMORY))


def test_several_queries_are_computed_together(one, rays, lazy):
    hits, dark, mean = dask.compute(
        one.cast_rays(*lazy), one.occluded(*lazy), one.count_intersections(*lazy)["counts"].mean()
    )
    assert_same_answer(hits, one.cast_rays(*rays))
    assert_same_answer(dark, one.occluded(*rays))
    assert mean == one.count_intersections(*rays)["counts"].mean()


@pytest.mark.parametrize("on", ["cluster", "threads"])
def test_persist(shared_client, one, rays, lazy, on):
    with dask.config.set(scheduler=shared_client if on == "cluster" else on):
        (kept,) = dask.persist(one.cast_rays(*lazy))
        assert type(kept) is LazyAnswer and len(kept["t_hit"].dask) == 4
        assert_same_answer(kept.compute(), one.cast_rays(*rays))
        again = one.cast_rays(*lazy).persist()
        assert again.stats.compute().total.rays.eye == RAYS


@pytest.mark.parametrize("name", QUERIES)
def test_a_block_is_traced_once_for_arrays_and_counters(one, lazy, monkeypatch, name):
    traced = []
    call = blocks.BlockQuery.__call__
    monkeypatch.setattr(
        blocks.BlockQuery, "__call__", lambda self, *given: traced.append(1) or call(self, *given)
    )
    answer = getattr(one, name)(*lazy)
    first, *_ = answer.values()
    for asked in ((answer,), (first, answer.stats), (first.sum(), answer), (answer.stats,)):
        *_, last = dask.compute(*asked)
        stats = last.stats if isinstance(last, bfrt.Answer) else last
        assert isinstance(stats, ClusterStats) and stats.total.rays.eye == RAYS
        assert len(traced) == 4
        traced.clear()
    answer.persist().compute()
    assert len(traced) == 4
    (kept,) = dask.persist(answer.stats)
    assert kept.compute().total.rays == answer.stats.persist().compute().total.rays
    assert len(traced) == 12


def test_a_block_is_traced_once_whatever_is_computed(one, lazy, monkeypatch):
    traced = []
    call = blocks.BlockQuery.__call__
    monkeypatch.setattr(
        blocks.BlockQuery, "__call__", lambda self, *given: traced.append(1) or call(self, *given)
    )
    answer = one.cast_rays(*lazy)
    assert traced == []  # nothing is done before it is asked for
    dask.compute(*answer.values())
    assert len(traced) == 4
    dask.compute(answer, one.cast_rays(*lazy))  # the same query has the same keys
    assert len(traced) == 8
    dask.compute(answer["t_hit"])
    assert len(traced) == 12


def test_counters_are_told_of_each_worker(shared_client, one, lazy):
    with dask.config.set(scheduler=shared_client):
        stats = one.cast_rays(*lazy).stats.compute()
    assert isinstance(stats, ClusterStats)
    assert all(re.fullmatch(r"worker \d+ \(tcp://.*\)", name) for name in stats.workers)
    assert sum(w.total.rays.eye for w in stats.workers.values()) == RAYS


def test_bad_rays_are_counted(one, rays):
    o, d = rays[0].copy(), rays[1].copy()
    o[[0, 999]], d[500] = np.nan, 0.0
    found = one.cast_rays(in_blocks(o), in_blocks(d)).compute()
    assert found.stats.bad_rays == 3
    assert_same_answer(found, one.cast_rays(o, d))


# --- rays ----------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", QUERIES)
def test_ends_of_each_ray(one, rays, lazy, name):
    near, far = np.linspace(0.1, 0.3, RAYS), np.linspace(0.5, 2.0, RAYS)
    expected = getattr(one, name)(*rays, near, far)
    for given in ((in_blocks(near, 100), in_blocks(far)), (near, in_blocks(far, RAYS))):
        assert_same_answer(getattr(one, name)(*lazy, *given).compute(), expected)
    expected = getattr(one, name)(*rays, t_max=1)
    assert_same_answer(getattr(one, name)(*lazy, t_max=1).compute(), expected)


def test_arrays_beside_dask_arrays(one, rays, lazy):
    expected = one.cast_rays(*rays)
    assert_same_answer(one.cast_rays(lazy[0], rays[1]).compute(), expected)
    assert_same_answer(one.cast_rays(rays[0], lazy[1]).compute(), expected)
    far = in_blocks(np.full(RAYS, np.inf))
    assert_same_answer(one.cast_rays(*rays, t_max=far).compute(), expected)


def test_other_blocks(one, rays):
    """Blocks of parts of rows, and of other numbers of rays."""
    o = da.from_array(rays[0], chunks=(250, 2))
    d = da.from_array(rays[1], chunks=((1, 999), 1))
    assert_same_answer(one.cast_rays(o, d).compute(), one.cast_rays(*rays))


@pytest.mark.parametrize("dtype", ["f4", ">f8", "i4"])
def test_numbers_of_other_types(one, rays, dtype):
    given = [(10 * part).astype(dtype) for part in rays]
    assert_same_answer(one.cast_rays(*map(in_blocks, given)).compute(), one.cast_rays(*given))


def test_blocks_of_unknown_sizes(one, rays, lazy):
    inside = rays[0][:, 0] > 0
    chosen = tuple(part[lazy[0][:, 0] > 0] for part in lazy)
    expected = one.cast_rays(rays[0][inside], rays[1][inside])
    assert_same_answer(one.cast_rays(*chosen).compute(), expected)
    with pytest.raises(SettingError, match="found blocks of unknown size, expected known ones"):
        one.list_intersections(*chosen)
    far = np.linspace(0.5, 2.0, RAYS)
    ends = in_blocks(far)[lazy[0][:, 0] > 0]
    expected = one.cast_rays(rays[0][inside], rays[1][inside], 0.1, far[inside])
    assert_same_answer(one.cast_rays(*chosen, 0.1, ends).compute(), expected)
    others = in_blocks(rays[1], 500)[in_blocks(rays[0], 500)[:, 0] > 0]
    with pytest.raises(SettingError, match="origins in 4 blocks and directions in 2, some of unkn"):
        one.cast_rays(chosen[0], others)
    with pytest.raises(SettingError, match=r"t_max: found .* in the blocks of the rays"):
        one.cast_rays(*chosen, t_max=others[:, 0])


def test_no_rays(one):
    none = da.zeros((0, 3), chunks=(10, 3))
    assert_same_answer(
        one.list_intersections(none, none).compute(),
        one.list_intersections(np.zeros((0, 3)), np.zeros((0, 3))),
    )


# --- what travels --------------------------------------------------------------------------------


def test_what_travels_is_small(one, lazy):
    query = blocks.BlockQuery(
        blocks.Work(blocks.Place.of(one.store), blocks.Asked(MEMORY, 1, "tree", *[None] * 4)),
        "cast_rays",
    )
    assert len(pickle.dumps(query)) < 1000
    graph = one.cast_rays(*lazy).__dask_graph__()
    assert not any(
        "store" in str(type(value)).lower() for layer in graph.layers.values()
        for value in layer.values()
    )  # fmt: skip


# --- refusals ------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("settings", "said"),
    [
        ({"out": "folder"}, "out: found one with dask arrays, expected None: dask.array.store"),
        ({"progress": True}, "progress: found one with dask arrays, expected False: dask.diagn"),
        ({"checkpoint": "x"}, "checkpoint: found one with dask arrays, expected None: dask.pers"),
        ({"memory": "much"}, "memory: found 'much', expected an amount"),
        ({"threads": 0}, "threads: found 0, expected a whole number"),
        ({"refine": "best"}, "refine: found 'best', expected one of"),
        ({"grid": 0}, "grid: found 0"),
        ({"t_max": "far"}, "t_max: found 'far', expected a number or (n,)"),
        ({"t_max": np.ones(7)}, "t_max: found float64 of shape (7,), expected a number or (1000,)"),
        ({"directions": None}, "directions: found none, expected an array"),
        ({"directions": [[1, 2, 3]]}, "directions: found list with dask arrays, expected an array"),
        ({"directions": ["a", "b", "c"]}, "rays: found <U1 of shape (3,), expected float32"),
        ({"directions": da.zeros((7, 3))}, "rays: found origins (1000, 3) and directions (7, 3)"),
        ({"directions": da.zeros((1000, 2))}, "directions: found float64 of shape (1000, 2)"),
        ({"directions": da.zeros((1000, 3), dtype="c8")}, "directions: found complex64 of shape"),
        ({"t_min": da.zeros(())}, "t_min: found float64 of shape ()"),
        (
            {"origins": np.zeros((1, 3)), "directions": np.ones((1, 3)), "t_min": da.zeros(())},
            "rays: found a dask array of no axis",
        ),
    ],
)
def test_what_is_refused_at_once(one, lazy, settings, said):
    given = {"origins": lazy[0], "directions": lazy[1], **settings}
    with pytest.raises(SettingError) as caught:
        one.cast_rays(**given)
    assert str(caught.value).startswith(said)


def test_too_small_a_budget_is_refused(one, lazy):
    with pytest.raises(bfrt.BudgetError, match=r"expected .* or more for rays of this scene"):
        one.cast_rays(*lazy, memory="1MiB").compute()
