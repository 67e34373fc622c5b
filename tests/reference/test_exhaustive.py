"""The slow twin against the oracle that shares no formula with it, and against its own promises."""

from __future__ import annotations

import tracemalloc

import fast
import numpy as np
import pytest
from scenes import hard_scenes, joined, moved, random_objects, random_rays, twice

from bfrt.errors import SettingError
from bfrt.records import INDEX_BITS, NO_HIT, Kind
from bfrt.reference import exhaustive, independent
from bfrt.reference.independent import Objects, agree, stable

NAMES = sorted(hard_scenes(np.random.default_rng(0)))
UNIT_SPHERE = Objects(spheres=[[0, 0, 0, 1]])
WALL = Objects(vertices=[[-4, -4, 0], [4, -4, 0], [4, 4, 0], [-4, 4, 0]], counts=[4])


def all_rays(rng, objects, n):
    rays = random_rays(rng, objects, n)
    origins, directions = (np.concatenate(some) for some in zip(*rays.values(), strict=True))
    return origins, directions, np.repeat(list(rays), n)


def check_against_oracle(objects, store, origins, directions, sorts=None):
    """No ray that is stable may differ; returns how many were compared."""
    t, ids = exhaustive.nearest(store, origins - np.array(store.origin), directions)
    expected = independent.nearest(objects, origins, directions)
    mask = stable(objects, origins, directions, *expected)
    report = agree(*expected, t, ids, mask)
    assert report.wrong == 0, None if sorts is None else sorts[report.rows]
    return report


@pytest.mark.parametrize("dtype", [np.float32, np.float64], ids=["float32", "float64"])
@pytest.mark.parametrize("name", NAMES)
def test_agrees_with_the_oracle(tmp_path, name, dtype):
    """Stores of float32 are relative to zero, those of float64 to the first block's centre."""
    rng = np.random.default_rng(NAMES.index(name))
    objects = fast.stored(hard_scenes(rng)[name], dtype)
    store = fast.write(objects, tmp_path / "s.bfrt", dtype)
    assert (dtype is np.float64 and len(objects) > 0) == any(store.origin)
    origins, directions, sorts = all_rays(rng, objects, 20)
    report = check_against_oracle(objects, store, origins, directions, sorts)
    assert report.compared > 0.4 * len(origins)
    assert report.tied == 0 or name == "flat"


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(40))
def test_agrees_with_the_oracle_on_many(tmp_path, seed):
    rng = np.random.default_rng([77, seed])
    scenes = hard_scenes(rng)
    dtype = (np.float32, np.float64)[seed % 2]
    objects = fast.stored(scenes[NAMES[seed % len(NAMES)]], dtype)
    store = fast.write(objects, tmp_path / "s.bfrt", dtype)
    check_against_oracle(objects, store, *all_rays(rng, objects, 400))


def test_a_given_origin_moves_no_hit(tmp_path):
    """Small objects at map coordinates: relative to an origin nearby, and to one far away."""
    rng = np.random.default_rng(8)
    objects = fast.stored(moved(random_objects(rng, 200), np.array([5e5, 4.5e6, -120.0])))
    origins, directions, sorts = all_rays(rng, objects, 20)
    for n, origin in enumerate([(5e5, 4.5e6, 0.0), (0.0, 0.0, 0.0)]):
        store = fast.write(objects, tmp_path / f"{n}.bfrt", origin=origin)
        assert store.origin == origin
        check_against_oracle(objects, store, origins, directions, sorts)


def test_outliers_are_objects_too(tmp_path):
    objects = joined(random_objects(np.random.default_rng(9), 300, spread=1.0, size=0.1), WALL)
    store = fast.write(fast.stored(objects), tmp_path / "s.bfrt", origin=(0, 0, 0))
    (wall,) = store.groups[0].outliers
    t, ids = exhaustive.nearest(store, [[3.5, 3.5, 2.0]], [[0.0, 0.0, -1.0]])
    assert (t[0], ids[0]) == (2.0, wall)
    assert wall >> INDEX_BITS == Kind.POLYGON


def test_the_lesser_id_wins_a_tie(tmp_path):
    rng = np.random.default_rng(10)
    objects = fast.stored(random_objects(rng, 60))
    once = fast.write(objects, tmp_path / "once.bfrt", origin=(0, 0, 0))
    double = fast.write(twice(objects), tmp_path / "twice.bfrt", origin=(0, 0, 0))
    origins, directions, _ = all_rays(rng, objects, 20)
    expected = exhaustive.nearest(once, origins, directions)
    assert np.isfinite(expected[0]).sum() > 50
    found = exhaustive.nearest(double, origins, directions)
    for a, b in zip(expected, found, strict=True):
        np.testing.assert_array_equal(a, b)


def test_neither_threads_nor_chunks_change_a_bit(tmp_path, monkeypatch):
    rng = np.random.default_rng(11)
    objects = fast.stored(random_objects(rng, 50, size=3.0))
    store = fast.write(objects, tmp_path / "s.bfrt")
    origins, directions, _ = all_rays(rng, objects, 40)
    expected = exhaustive.nearest(store, origins, directions)
    assert np.isfinite(expected[0]).any()
    for threads, chunk in ((2, 1), (3, 97), (1, 7)):
        monkeypatch.setattr(exhaustive, "RAYS", chunk)
        found = exhaustive.nearest(store, origins, directions, threads=threads)
        for a, b in zip(expected, found, strict=True):
            np.testing.assert_array_equal(a, b)


def test_t_max_is_excluded(tmp_path):
    store = fast.write(UNIT_SPHERE, tmp_path / "s.bfrt", origin=(0, 0, 0))
    origins, directions = [[-3, 0, 0]] * 4, [[1, 0, 0]] * 4
    limits = [2.0, np.nextafter(2.0, 3.0), 1.0, np.nan]
    t, ids = exhaustive.nearest(store, origins, directions, limits)
    np.testing.assert_array_equal(t, [np.inf, 2.0, np.inf, np.inf])
    np.testing.assert_array_equal(ids, [NO_HIT, 0, NO_HIT, NO_HIT])
    dark = exhaustive.occluded(store, origins, directions, limits)
    np.testing.assert_array_equal(dark, [False, True, False, False])


def test_rays_that_are_none_miss(tmp_path):
    store = fast.write(UNIT_SPHERE, tmp_path / "s.bfrt", origin=(0, 0, 0))
    nan, inf = np.nan, np.inf
    origins = [[0, 0, 0], [nan, 0, 0], [0, inf, 0], [0, 0, 0], [0, 0, 0], [0, 0, 0]]
    directions = [[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, nan], [-inf, 0, 0], [0, 0, 1]]
    t, ids = exhaustive.nearest(store, origins, directions)
    np.testing.assert_array_equal(t, [inf] * 5 + [1.0])
    np.testing.assert_array_equal(ids, [NO_HIT] * 5 + [0])


def test_no_rays_and_no_objects(tmp_path):
    store = fast.write(UNIT_SPHERE, tmp_path / "s.bfrt")
    t, ids = exhaustive.nearest(store, np.empty((0, 3)), np.empty((0, 3)))
    assert t.shape == ids.shape == (0,)
    empty = fast.write(Objects(), tmp_path / "empty.bfrt")
    t, ids = exhaustive.nearest(empty, np.zeros((3, 3)), np.ones((3, 3)))
    assert (t == np.inf).all()
    assert (ids == NO_HIT).all()


def test_what_is_given_stays_as_it_is(tmp_path):
    store = fast.write(UNIT_SPHERE, tmp_path / "s.bfrt", origin=(0, 0, 0))
    origins, directions = np.array([[-1e9, 0.0, 0.0]]), np.array([[1.0, 0.0, 0.0]])
    t, _ = exhaustive.nearest(store, origins, directions)
    assert t[0] == 1e9 - 1
    np.testing.assert_array_equal(origins, [[-1e9, 0, 0]])


@pytest.mark.parametrize("shapes", [((2, 3), (3, 3)), ((3,), (3,)), ((2, 2), (2, 2))], ids=str)
def test_shapes_are_checked(tmp_path, shapes):
    store = fast.write(UNIT_SPHERE, tmp_path / "s.bfrt")
    with pytest.raises(SettingError, match="expected \\(n, 3\\)"):
        exhaustive.nearest(store, np.zeros(shapes[0]), np.ones(shapes[1]))


def test_memory_is_bounded(tmp_path):
    """Beside the answers, a million rays take no more than a few chunks do."""
    store = fast.write(UNIT_SPHERE, tmp_path / "s.bfrt")
    peaks = []
    for n in (100_000, 300_000):
        rays = np.tile([[-3.0, 0.0, 0.0]], (n, 1)), np.tile([[1.0, 0.0, 0.0]], (n, 1))
        tracemalloc.start()
        exhaustive.nearest(store, *rays)
        peaks.append(tracemalloc.get_traced_memory()[1])
        tracemalloc.stop()
    assert peaks[1] - peaks[0] < 200_000 * 20  # 16 bytes of answers, and a mask
