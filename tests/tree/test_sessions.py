"""What breaks a query off leaves the scene as it was; threads and processes share one."""

from __future__ import annotations

import copy
import itertools
import multiprocessing
import pickle
import signal
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest
from scenes import random_objects, random_rays
from treelets import FORMS, QUERIES, answers, formed, pair, same

from bfrt.errors import Cancelled
from bfrt.scene import Scene
from bfrt.store.model import Camera

VIEW = Camera((0.1, -9.0, 1.0), (0.0, 0.0, 0.0), resolution=(20, 20))


@pytest.fixture(scope="module")
def asked(tmp_path_factory):
    """A store in small treelets, rays, and the answers."""
    rng = np.random.default_rng(71)
    objects = random_objects(rng, 1200)
    store = pair(objects, tmp_path_factory.mktemp("sessions"))[1]
    some = random_rays(rng, objects, 12).values()
    rays = tuple(np.concatenate(each) for each in zip(*some, strict=True))
    return store, rays, answers(Scene(store), *rays, refine="sgb")


def interrupted(number, way):
    """Progress that breaks off at its call of that number."""
    calls = itertools.count()

    def progress(_):
        if next(calls) < number:
            return None
        if way is Cancelled:
            return False
        raise way

    return progress


@pytest.mark.parametrize("way", [KeyboardInterrupt, Cancelled, MemoryError])
@pytest.mark.parametrize("form", FORMS)
def test_a_query_that_is_broken_off(asked, form, way, tmp_path):
    store, rays, expected = asked
    with formed(store, form) as scene:
        for query, number in itertools.product(QUERIES, (0, 1, 2)):
            blocks = ((o, d) for o, d in zip(*(np.array_split(r, 4) for r in rays), strict=True))
            given = rays if number else (blocks,)
            out = tmp_path / f"{query} {number}"
            try:
                getattr(scene, query)(*given, progress=interrupted(number, way), out=out)
            except way:
                assert not list(out.glob("*"))
            else:  # there were no more calls
                assert number
        same(expected, answers(scene, *rays, threads=3))


@pytest.mark.parametrize("form", FORMS)
def test_a_render_that_is_broken_off(asked, form):
    store, rays, expected = asked
    with formed(store, form) as scene:
        whole = scene.render(camera=VIEW)
        for number in (0, 1, 3):
            with pytest.raises(KeyboardInterrupt):
                scene.render(camera=VIEW, progress=interrupted(number, KeyboardInterrupt))
            image = scene.render(camera=VIEW, threads=2)
            for name, channel in whole.channels.items():
                np.testing.assert_array_equal(image.channels[name], channel)
        same(expected, answers(scene, *rays))


# Python loses one that comes in a callback of its own.
@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")
@pytest.mark.parametrize("form", ["resident", "streamed"])
def test_interrupts_at_any_time(asked, form):
    """Of the system's clock, while threads are at work."""
    store, rays, expected = asked
    many = tuple(np.tile(each, (200, 1)) for each in rays)
    before = signal.signal(signal.SIGALRM, signal.default_int_handler)
    heard = 0
    try:
        with formed(store, form) as scene:
            for step in range(12):
                signal.setitimer(signal.ITIMER_REAL, 0.001 + 0.004 * step)
                try:
                    scene.cast_rays(*many, threads=2)
                    scene.count_intersections(*many, threads=2)
                    time.sleep(0.2)
                except KeyboardInterrupt:
                    heard += 1
            signal.setitimer(signal.ITIMER_REAL, 0)
            assert heard >= 8
            same(expected, answers(scene, *rays, threads=2))
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)
        signal.signal(signal.SIGALRM, before)


@pytest.mark.parametrize("form", FORMS)
def test_threads_that_ask_one_scene(asked, form):
    store, rays, expected = asked
    with formed(store, form) as scene, ThreadPoolExecutor(4) as pool:
        asks = [pool.submit(answers, scene, *rays, threads=1 + number % 3) for number in range(8)]
        image = scene.render(camera=VIEW)
        for ask in asks:
            same(expected, ask.result())
    shown = Scene(store).render(camera=VIEW, refine="sgb")
    for name, channel in shown.channels.items():
        np.testing.assert_array_equal(image.channels[name], channel)


def test_one_that_is_broken_off_beside_others(asked):
    store, rays, expected = asked
    with Scene(store) as scene, ThreadPoolExecutor(3) as pool:
        asks = [pool.submit(answers, scene, *rays) for _ in range(4)]
        for number in range(6):
            with pytest.raises(Cancelled):
                scene.cast_rays(*rays, progress=interrupted(number % 2, Cancelled))
        for ask in asks:
            same(expected, ask.result())


@pytest.mark.parametrize(
    "again",
    [copy.copy, copy.deepcopy, lambda scene: pickle.loads(pickle.dumps(scene))],
    ids=["copy", "deepcopy", "pickle"],
)
def test_a_copy_asks_for_itself(asked, again):
    store, rays, expected = asked
    with Scene(store) as scene:
        scene.cast_rays(*rays)
        with again(scene) as other:
            same(expected, answers(other, *rays))
            assert other.cast_rays(*rays).stats.tree["resident"]
        same(expected, answers(scene, *rays))


@pytest.mark.parametrize("form", ["resident", "streamed"])
def test_a_forked_process(asked, tmp_path, form):
    """It has the scene, but none of its threads."""
    if "fork" not in multiprocessing.get_all_start_methods():
        pytest.skip("no fork here")
    store, rays, expected = asked
    many = tuple(np.tile(each, (40, 1)) for each in rays)
    scene = formed(store, form)
    scene.cast_rays(*many, threads=3)
    file = tmp_path / "t.npy"

    def ask(path: Path) -> None:
        np.save(path, scene.cast_rays(*many, threads=3)["t_hit"])

    child = multiprocessing.get_context("fork").Process(target=ask, args=(file,), daemon=True)
    child.start()
    child.join(120)
    assert child.exitcode == 0
    np.testing.assert_array_equal(np.load(file), np.tile(expected["cast_rays t_hit"], 40))
    same(expected, answers(scene, *rays, threads=3))


def test_a_session_serves_other_settings_too(asked):
    """Threads, budgets and refinements change by turns; what stays in memory is read again."""
    store, rays, expected = asked
    with Scene(store) as scene:
        for settings in (
            {"threads": 1}, {"threads": 2}, {"refine": "sgb"}, {"memory": "90MiB"}, {"grid": 5},
            {"threads": 2, "memory": "80MiB", "refine": "tree"}, {"refine": "base"},
        ):  # fmt: skip
            same(expected, answers(scene, *rays, **settings))
