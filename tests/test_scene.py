"""An open scene: what it tells, what it keeps between queries, and what it gives back."""

from __future__ import annotations

import copy
import gc
import inspect
import multiprocessing
import operator
import pickle
import threading
import time
from pathlib import Path

import numpy as np
import pytest
from meshes import open_files
from running import thread_names

import bfrt
from bfrt.records import Kind
from bfrt.scene import Geometry
from bfrt.tracer import Tracer

ORIGIN = (5e5, 4.5e6, 100.0)
MEMORY = {"memory": "128MiB", "threads": 2}

#: What asks about rays.
QUERIES = ("cast_rays", "occluded", "count_intersections", "list_intersections")


@pytest.fixture(scope="module")
def path(tmp_path_factory):
    """Spheres and triangles in two groups, in a box of about 4 x 2 x 1 on map coordinates."""
    path = tmp_path_factory.mktemp("scene") / "two.bfrt"
    rng = np.random.default_rng(3)
    with bfrt.SceneWriter(path, origin=ORIGIN) as writer:
        for group in range(2):
            places = rng.uniform([0, 0, 0], [4, 2, 1], (300, 3)) + ORIGIN
            writer.spheres(places, 0.05, group=group)
        corners = places[:200, None] + rng.uniform(-0.2, 0.2, (200, 3, 3))
        writer.triangles(corners, group=1)
    return path


@pytest.fixture
def scene(path):
    with bfrt.open(path) as opened:
        yield opened


@pytest.fixture(scope="module")
def rays():
    """From above and from below, slanting, at random places of the box."""
    rng = np.random.default_rng(4)
    ends = rng.uniform([0, 0, 0], [4, 2, 1], (500, 3)) + ORIGIN
    ways = rng.normal(size=(500, 3))
    return ends - 3 * ways, ways


@pytest.fixture(scope="module")
def expected(path, rays):
    """What each query answers that has a scene for itself."""
    return {name: getattr(bfrt, name)(path, *rays, **MEMORY) for name in QUERIES}


@pytest.fixture
def made(monkeypatch):
    """The settings of the sessions that are made from here on."""
    settings = []
    begin = Tracer.__init__

    def counted(self, store, given, capacities):
        settings.append(given)
        begin(self, store, given, capacities)

    monkeypatch.setattr(Tracer, "__init__", counted)
    return settings


def same(answer, other):
    assert answer.keys() == other.keys()
    for key, values in answer.items():
        assert values.dtype == other[key].dtype
        np.testing.assert_array_equal(values, other[key], key)


def threads():
    """Workers of sessions."""
    return sum(name.startswith("bfrt") for name in thread_names())


# --- what it tells -------------------------------------------------------------------------------


def test_what_it_is_called(scene, path):
    assert repr(scene) == f"<Scene {str(path)!r}: 800 objects>"
    assert scene.path == path
    assert scene.objects == 800
    assert scene.bytes == scene.store.bytes


def test_bounds_are_in_world_coordinates(scene):
    assert scene.origin == ORIGIN
    assert (scene.bounds.lo.dtype, scene.bounds.lo.shape) == (np.float64, (3,))
    np.testing.assert_allclose(scene.bounds.lo - ORIGIN, [0, 0, 0], atol=0.3)
    np.testing.assert_allclose(scene.bounds.hi - ORIGIN, [4, 2, 1], atol=0.3)
    np.testing.assert_array_equal(scene.bounds.lo, scene.store.bounds.lo + ORIGIN)
    np.testing.assert_array_equal(scene.bounds.hi, scene.store.bounds.hi + ORIGIN)


def test_nothing_has_no_bounds(tmp_path):
    empty = bfrt.SceneWriter(tmp_path / "empty.bfrt", origin=ORIGIN).close()
    assert (empty.bounds.lo == np.inf).all() and (empty.bounds.hi == -np.inf).all()
    assert empty.geometries == {}
    assert empty.objects == 0


def test_geometries_explain_the_ids(scene, expected):
    spheres, triangles = int(Kind.SPHERE), int(Kind.TRIANGLE)
    assert scene.geometries == {
        spheres: Geometry(0, Kind.SPHERE, 300),
        16 + spheres: Geometry(1, Kind.SPHERE, 300),
        16 + triangles: Geometry(1, Kind.TRIANGLE, 200),
    }
    hits = expected["cast_rays"]
    hit = hits["geometry_ids"] >= 0
    assert set(hits["geometry_ids"][hit].tolist()) == scene.geometries.keys()
    for number, geometry in scene.geometries.items():
        places = hits["primitive_ids"][hits["geometry_ids"] == number]
        assert 0 <= places.min() <= places.max() < geometry.count


def test_a_scene_has_what_was_written(tmp_path):
    camera, light = bfrt.Camera((0, -5, 0), (0, 0, 0)), bfrt.Light((1, 2, 3))
    with bfrt.SceneWriter(tmp_path / "a.bfrt") as writer:
        writer.camera(camera)
        writer.light(light)
        writer.background((0.25, 0.5, 1.0))
        writer.spheres([[0.0, 0, 0]], 1.0, writer.material(bfrt.Material(kd=0.5)))
        closed = writer.close()
    for scene in (closed, bfrt.open(tmp_path / "a.bfrt")):
        assert isinstance(scene, bfrt.Scene)
        assert (scene.camera, scene.lights, scene.background) == (camera, [light], (0.25, 0.5, 1))
        assert scene.materials()["kd"].tolist() == [0.5]
        scene.verify()
    (tmp_path / "a.bfrt" / "palette").write_bytes(bytes(32))
    with pytest.raises(bfrt.StoreError, match="the contents differ from what was written"):
        scene.verify()


def test_what_makes_a_store_returns_a_scene(tmp_path):
    converted = bfrt.convert("spd:tetra:2", tmp_path / "a.bfrt")
    written = bfrt.spd.tetra(2).write(tmp_path / "b.bfrt")
    for scene in (converted, written):
        assert isinstance(scene, bfrt.Scene)
        assert scene.cast_rays([[0, 0, 5.0]], [[0, 0, -1.0]], **MEMORY)["t_hit"].shape == (1,)


def test_what_is_no_store_is_refused(tmp_path):
    for ask in (bfrt.open, bfrt.plan, bfrt.render, bfrt.framing_camera):
        with pytest.raises(bfrt.StoreError, match="not a scene store: expected a directory"):
            ask(tmp_path / "none.bfrt")


# --- functions and methods -----------------------------------------------------------------------


@pytest.mark.parametrize("name", QUERIES)
def test_a_function_takes_a_scene_or_where_one_is(scene, path, rays, expected, name):
    ask = getattr(bfrt, name)
    for given in (scene, path, str(path)):
        same(ask(given, *rays, **MEMORY), expected[name])
    same(getattr(scene, name)(*rays, **MEMORY), expected[name])


def test_pictures_plans_and_cameras_of_a_scene_or_where_one_is(scene, path):
    size = {"resolution": (24, 16)}
    camera = bfrt.framing_camera(path, **size)
    assert bfrt.framing_camera(scene, **size) == scene.framing_camera(**size) == camera
    plan = bfrt.plan(path, camera=camera, **MEMORY)
    assert bfrt.plan(scene, camera=camera, **MEMORY) == scene.plan(camera=camera, **MEMORY) == plan
    images = [
        ask(camera=camera, **MEMORY)
        for ask in (scene.render, lambda **given: bfrt.render(str(path), **given))
    ]
    for name, channel in images[0].channels.items():
        assert channel.tobytes() == images[1].channels[name].tobytes(), name


@pytest.mark.parametrize("name", [*QUERIES, "render", "plan", "framing_camera"])
def test_functions_have_the_methods_words(name):
    function, method = getattr(bfrt, name), getattr(bfrt.Scene, name)
    assert function.__doc__ == method.__doc__
    assert function.__name__ == function.__qualname__ == name
    first, *others = inspect.signature(function).parameters.values()
    assert first.name == "scene"
    assert others == list(inspect.signature(method).parameters.values())[1:]
    assert pickle.loads(pickle.dumps(function)) is function


# --- what it keeps -------------------------------------------------------------------------------


@pytest.mark.parametrize("refine", ["sgb", "tree"])
def test_a_second_query_makes_nothing_again(scene, rays, expected, made, refine):
    before = open_files()
    first = scene.cast_rays(*rays, **MEMORY, refine=refine)
    kept = open_files(), threads()
    assert kept[0] > before
    for name in (*QUERIES, *QUERIES):
        answer = getattr(scene, name)(*rays, **MEMORY, refine=refine)
        same(answer, expected[name])
        assert answer.stats.marks_reused == (refine == "sgb")
        assert (answer.stats.grids, answer.stats.tree) == (first.stats.grids, first.stats.tree)
        assert answer.stats.total.treelets_read == 0
        assert answer.stats.total.phases.preprocess.seconds == 0.0
        assert (open_files(), threads()) == kept
    assert len(made) == 1


def test_other_settings_make_another_session(scene, rays, expected, made):
    for settings in (
        {"memory": "128MiB"},
        {"memory": "128MiB", "refine": "base"},
        {"memory": "128MiB", "refine": "base", "threads": 1},
        {"memory": "96MiB", "threads": 1},
        {"memory": "96MiB", "threads": 1, "grid": 5},
        {"memory": "96MiB", "threads": 1, "max_grid": 5},
        {"memory": "128MiB"},  # which was given back
    ):
        before = len(made)
        for _ in range(2):
            same(scene.cast_rays(*rays, **settings), expected["cast_rays"])
        assert len(made) == before + 1


def test_the_same_settings_in_other_words_make_none(scene, rays, made, tmp_path):
    scene.occluded(*rays, memory="128MiB", threads=2, scratch=tmp_path)
    scene.occluded(*rays, memory=128 << 20, threads=np.int64(2), scratch=str(tmp_path))
    assert len(made) == 1


def test_fresh_marks_are_made_each_time(scene, rays, expected, made):
    for _ in range(2):
        answer = scene.cast_rays(*rays, fresh_marks=True, **MEMORY)
        same(answer, expected["cast_rays"])
        assert not answer.stats.marks_reused
        assert answer.stats.total.phases.preprocess.seconds > 0.0
    assert len(made) == 2


def test_what_is_prepared_is_counted_once(tmp_path):
    """Those who come after have all of it for nothing: also the marks."""
    scene = bfrt.spd.rings(2).write(tmp_path / "r.bfrt")
    one, two = (scene.occluded([[9.0, 9, 9]], [[-1.0, -1, -1]], **MEMORY) for _ in range(2))
    assert not one.stats.marks_reused and two.stats.marks_reused
    assert one.stats.total.phases.preprocess.bytes_read > 0
    assert two.stats.total.phases.preprocess.bytes_read == 0


def test_one_ray_takes_hardly_any_time(tmp_path):
    """Of an open scene of 8,401 objects: the quickest of many calls, for others work here too."""
    scene = bfrt.spd.rings(7).write(tmp_path / "rings.bfrt")
    o, d = np.array([[4.0, 3, 2]]), np.array([[-4.0, -3, -2]])
    first = scene.cast_rays(o, d, memory="256MiB")
    seconds = []
    for _ in range(50):
        start = time.perf_counter()
        answer = scene.cast_rays(o, d, memory="256MiB")
        seconds.append(time.perf_counter() - start)
        same(answer, first)
    assert min(seconds) < 0.005


# --- what it gives back --------------------------------------------------------------------------


def test_a_closed_scene_has_given_all_back_and_can_be_asked_again(path, rays, expected, made):
    gc.collect()
    scene = bfrt.open(path)
    before = open_files(), threads()
    with scene:
        same(scene.cast_rays(*rays, **MEMORY), expected["cast_rays"])
        assert open_files() > before[0]
    assert (open_files(), threads()) == before
    same(scene.cast_rays(*rays, **MEMORY), expected["cast_rays"])
    assert len(made) == 2
    scene.close()
    scene.close()
    assert (open_files(), threads()) == before


def test_a_scene_that_is_forgotten_gives_all_back(path, rays):
    gc.collect()
    before = open_files(), threads()
    scene = bfrt.open(path)
    scene.cast_rays(*rays, **MEMORY)
    assert open_files() > before[0]
    del scene
    gc.collect()
    assert (open_files(), threads()) == before


def test_a_function_of_a_path_keeps_nothing(path, rays):
    gc.collect()
    before = open_files(), threads()
    bfrt.cast_rays(path, *rays, **MEMORY)
    assert (open_files(), threads()) == before


def test_a_picture_has_the_whole_budget(scene, rays, monkeypatch):
    """What a query has taken is given back before a render takes its own."""
    events = []
    begin, close = Tracer.__init__, Tracer.close

    def begun(self, *given):
        events.append("begun")
        begin(self, *given)

    def closed(self):
        events.append("closed")
        close(self)

    monkeypatch.setattr(Tracer, "__init__", begun)
    monkeypatch.setattr(Tracer, "close", closed)
    scene.cast_rays(*rays, **MEMORY)
    assert events == ["begun"]
    scene.render(camera=scene.framing_camera(resolution=(8, 8)), **MEMORY)
    assert events == ["begun", "closed"] * 2


# --- several at a time ---------------------------------------------------------------------------


def test_a_query_while_another_is_worked_on(scene, rays, expected, made):
    """The second is asked and answered by another thread before the first has gone on."""
    found = []

    def meanwhile(progress):
        if not found:
            other = threading.Thread(
                target=lambda: found.append(scene.cast_rays(*rays, **MEMORY)), daemon=True
            )
            other.start()
            other.join(60)
            assert not other.is_alive()

    same(scene.cast_rays(*rays, progress=meanwhile, **MEMORY), expected["cast_rays"])
    same(found[0], expected["cast_rays"])
    assert len(made) == 2


def test_many_threads_ask_one_scene(scene, rays, expected):
    found, failed = [], []

    def ask(name):
        try:
            for _ in range(5):
                found.append((name, getattr(scene, name)(*rays, **MEMORY)))
        except BaseException as error:
            failed.append(error)

    asking = [threading.Thread(target=ask, args=(name,)) for name in QUERIES]
    for thread in asking:
        thread.start()
    for thread in asking:
        thread.join()
    assert not failed
    assert len(found) == 5 * len(QUERIES)
    for name, answer in found:
        same(answer, expected[name])


def test_rays_that_are_answers_of_the_same_scene(scene, rays, expected, made):
    """A block is made by a query while the query that takes it is worked on."""
    before = open_files()

    def blocks():
        for part in (slice(0, 200), slice(200, None)):
            some = rays[0][part], rays[1][part]
            near = scene.cast_rays(*some, **MEMORY)
            np.testing.assert_array_equal(near["t_hit"], expected["cast_rays"]["t_hit"][part])
            yield some

    same(scene.cast_rays(blocks(), **MEMORY), expected["cast_rays"])
    same(scene.cast_rays(*rays, **MEMORY), expected["cast_rays"])
    assert len(made) == 2  # the one that waits in the other, and its own
    scene.close()
    assert open_files() == before


def test_a_scene_is_closed_by_what_a_query_calls(scene, rays, expected):
    """It does not wait for itself."""
    found = []

    def ask():
        answer = scene.cast_rays(*rays, progress=lambda _: scene.close(), **MEMORY)
        found.append(answer)

    asking = threading.Thread(target=ask, daemon=True)
    asking.start()
    asking.join(60)
    same(found[0], expected["cast_rays"])


# --- when something goes wrong -------------------------------------------------------------------


def test_a_cancelled_query_leaves_a_scene_that_can_be_asked(scene, rays, expected, made):
    before = open_files(), threads()
    for _ in range(2):
        with pytest.raises(bfrt.Cancelled):
            scene.cast_rays(*rays, progress=lambda _: False, **MEMORY)
        assert (open_files(), threads()) == before
    same(scene.cast_rays(*rays, **MEMORY), expected["cast_rays"])
    assert len(made) == 3


def test_a_query_whose_rays_fail_leaves_a_scene_that_can_be_asked(scene, rays, expected):
    def blocks():
        yield rays
        raise ZeroDivisionError("the second block")

    same(scene.cast_rays(*rays, **MEMORY), expected["cast_rays"])
    for name in QUERIES:
        with pytest.raises(ZeroDivisionError, match="the second block"):
            getattr(scene, name)(blocks(), **MEMORY)
        same(getattr(scene, name)(*rays, **MEMORY), expected[name])


def test_a_query_of_a_damaged_store_leaves_a_scene_that_can_be_asked(tmp_path):
    scene = bfrt.spd.rings(2).write(tmp_path / "r.bfrt")
    rays = np.full((50, 3), 9.0), np.random.default_rng(1).normal(-9, 2, (50, 3))
    expected = scene.cast_rays(*rays, **MEMORY)
    assert np.isfinite(expected["t_hit"]).any()
    scene.close()
    whole = {s.path("geometry"): s.path("geometry").read_bytes() for s in scene.store.streams}
    for file in whole:
        file.unlink()
    with pytest.raises(bfrt.StoreError, match="geometry: the file is missing"):
        scene.cast_rays(*rays, **MEMORY)
    for file, data in whole.items():
        file.write_bytes(data)
    same(scene.cast_rays(*rays, **MEMORY), expected)


def test_what_is_refused_keeps_what_there_is(scene, rays, expected, made):
    scene.cast_rays(*rays, **MEMORY)
    for wrong in ({"out": {"t_hit": np.empty(3)}}, {"threads": 0}, {"refine": "best"}):
        with pytest.raises(bfrt.SettingError):
            scene.cast_rays(*rays, **{**MEMORY, **wrong})
    with pytest.raises(bfrt.BudgetError):
        scene.plan(memory="1MiB")
    same(scene.cast_rays(*rays, **MEMORY), expected["cast_rays"])
    assert len(made) == 1


# --- copies --------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "copied",
    [copy.copy, copy.deepcopy, lambda scene: pickle.loads(pickle.dumps(scene))],
    ids=["copy", "deepcopy", "pickle"],
)
def test_a_copy_prepares_for_itself(scene, rays, expected, copied):
    """And what it gives back is its own."""
    scene.cast_rays(*rays, **MEMORY)
    other = copied(scene)
    assert (other.path, other.geometries) == (scene.path, scene.geometries)
    same(other.cast_rays(*rays, **MEMORY), expected["cast_rays"])
    del other
    gc.collect()
    same(scene.cast_rays(*rays, **MEMORY), expected["cast_rays"])


@pytest.mark.parametrize("way", ["fork", "spawn"])
def test_another_process_asks(scene, rays, expected, way):
    """A process that was forked has the scene, but none of the threads."""
    if way not in multiprocessing.get_all_start_methods():
        pytest.skip(f"no {way} here")
    many = tuple(np.tile(part, (40, 1)) for part in rays)
    scene.cast_rays(*many, **MEMORY)
    ask = operator.methodcaller("cast_rays", *many, **MEMORY)
    with multiprocessing.get_context(way).Pool(1) as pool:
        found = pool.apply_async(ask, (scene,)).get(120)
    np.testing.assert_array_equal(found["t_hit"], np.tile(expected["cast_rays"]["t_hit"], 40))
    same(scene.cast_rays(*rays, **MEMORY), expected["cast_rays"])


def test_a_forked_process_asks_the_scene_it_was_forked_with(scene, rays, expected, tmp_path):
    if "fork" not in multiprocessing.get_all_start_methods():
        pytest.skip("no fork here")
    many = tuple(np.tile(part, (40, 1)) for part in rays)
    scene.cast_rays(*many, **MEMORY)
    file = tmp_path / "t.npy"

    def ask(path: Path) -> None:
        np.save(path, scene.cast_rays(*many, **MEMORY)["t_hit"])

    child = multiprocessing.get_context("fork").Process(target=ask, args=(file,), daemon=True)
    child.start()
    child.join(120)
    assert child.exitcode == 0
    np.testing.assert_array_equal(np.load(file), np.tile(expected["cast_rays"]["t_hit"], 40))
    same(scene.cast_rays(*many, **MEMORY), scene.cast_rays(*many, **MEMORY))
