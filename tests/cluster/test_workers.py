"""What a worker does: opens a store once, keeps its budget, and is replaced when it is killed."""

from __future__ import annotations

import dataclasses
import gc
import os
import re
import shutil
import signal
import sys
import threading
import time
from contextlib import contextmanager
from types import SimpleNamespace

import pytest
from cluster_fixtures import (
    MEMORY,
    NEEDED,
    assert_same_answer,
    assert_same_picture,
    build,
    cluster_of,
    executing,
    open_stores,
    pid,
    some_rays,
    wait_until,
)
from running import thread_names

import bfrt
from bfrt.cluster import reports, stores, worker
from bfrt.cluster.asked import Asked
from bfrt.errors import BudgetError, StoreError
from bfrt.memory import MOST

pytest.importorskip("distributed", reason=NEEDED)
import dask
import dask.array as da


@pytest.fixture
def scene(paths):
    with bfrt.open(paths["spatial"]) as opened:
        yield opened


def lazily(scene, count, rows, **settings):
    o, d = (da.from_array(part, chunks=(rows, 3)) for part in some_rays(count))
    return scene.cast_rays(o, d, memory=MEMORY, **settings)


# --- faults --------------------------------------------------------------------------------------


def test_a_worker_is_killed_while_it_renders(shared_client, paths):
    """Dask replaces it, and what it was at is done again."""
    scene = bfrt.open(paths["given"])
    camera = dataclasses.replace(scene.camera, resolution=(200, 160))
    settings = {"refine": "base", "memory": MEMORY, "camera": camera}
    expected = scene.render(**settings)
    before, killed = shared_client.run(pid), []

    def kill(progress):
        if progress.done and not killed:
            killed.append(next(iter(before.values())))
            os.kill(killed[0], signal.SIGKILL)

    found = scene.render(**settings, client=shared_client, progress=kill)
    assert_same_picture(found, expected)
    assert killed
    wait_until(lambda: len(shared_client.nthreads()) == 2)
    assert killed[0] not in shared_client.run(pid).values()


def test_a_worker_is_killed_while_it_answers(shared_client, scene):
    expected = scene.cast_rays(*some_rays(40_000), memory=MEMORY)
    wait_until(lambda: len(shared_client.nthreads()) == 2)
    victim = next(iter(shared_client.run(pid).values()))
    future = shared_client.compute(lazily(scene, 40_000, 1000))
    wait_until(lambda: any(shared_client.run(executing).values()) or future.done())
    os.kill(victim, signal.SIGKILL)
    assert_same_answer(future.result(), expected)
    wait_until(lambda: len(shared_client.nthreads()) == 2)


@pytest.mark.parametrize("ask", ["render", "cast_rays"])
def test_a_store_that_is_not_there(shared_client, tmp_path, ask):
    scene = build(tmp_path / "gone.bfrt", "spatial")
    shutil.rmtree(tmp_path / "gone.bfrt")
    with pytest.raises(StoreError) as caught, dask.config.set(scheduler=shared_client):
        if ask == "render":
            scene.render(memory=MEMORY, client=shared_client)
        else:
            lazily(scene, 10, 5).compute()
    assert re.fullmatch(
        rf"worker \d+ \(tcp://[\d.:]+\): {tmp_path}/gone.bfrt: not a scene store: expected a "
        "directory with scene.json",
        str(caught.value),
    )


def test_another_store_under_its_name(shared_client, tmp_path):
    """One that a worker has open, too, is not taken for the one that was meant."""
    path = tmp_path / "replaced.bfrt"
    old = build(path, "spatial")
    old.render(memory=MEMORY, client=shared_client)
    new = build(path, "spatial", size=2)
    with pytest.raises(StoreError) as caught:
        old.render(memory=MEMORY, client=shared_client)
    text = str(caught.value)
    assert re.match(rf"worker \d+ \(tcp://[\d.:]+\): {path}: ", text)
    assert "the store was replaced while it was open; open it again" in text or (
        f"found the store {new.store.checksum:08x}, expected {old.store.checksum:08x}" in text
    )
    assert_same_picture(new.render(memory=MEMORY, client=shared_client), new.render(memory=MEMORY))
    with pytest.raises(StoreError, match=f"expected {old.store.checksum:08x}, which was opened"):
        old.render(memory=MEMORY, client=shared_client)


@pytest.mark.parametrize("ask", ["render", "cast_rays"])
def test_more_memory_than_a_worker_has(shared_client, scene, ask):
    with pytest.raises(BudgetError) as caught, dask.config.set(scheduler=shared_client):
        if ask == "render":
            scene.render(memory="900MiB", client=shared_client)
        else:
            o, d = (da.from_array(part, chunks=(5, 3)) for part in some_rays(10))
            scene.cast_rays(o, d, memory="900MiB").compute()
    assert re.fullmatch(
        r"memory: found 900MiB, expected 819MiB or less: worker \d+ \(tcp://[\d.:]+\) is paused "
        "or ended beyond that",
        str(caught.value),
    )


@pytest.mark.skipif(sys.version_info < (3, 11), reason="errors have no notes before Python 3.11")
def test_other_errors_have_a_note(shared_client, scene):
    with pytest.raises(BudgetError, match=r"expected \d+MiB or more") as caught:
        scene.render(memory="1MiB", client=shared_client)
    (note,) = caught.value.__notes__
    assert re.fullmatch(r"found by worker \d+ \(tcp://[\d.:]+\)", note)


def test_the_default_budget_is_a_quarter_of_the_workers(shared_client, scene):
    image = scene.render(client=shared_client)
    assert image.stats.settings["memory"] <= (1 << 30) // 4
    assert image.stats.settings["threads"] == 1


class Pretended:
    """A worker of Dask's, as far as it is asked."""

    name, address, plugins = 5, "tcp://far:1", {}

    def __init__(self, limit, pause):
        self.memory_manager = SimpleNamespace(memory_limit=limit, memory_pause_fraction=pause)
        self.state = SimpleNamespace(nthreads=3)


@pytest.mark.parametrize(
    ("limit", "pause", "groups", "default", "most"),
    [
        (4000, 0.8, [], 1000, 3200),
        (4000, False, [], 1000, 4000),  # one that is never paused
        (4000, 0.8, [3000, 2000], 500, 2000),  # in a cgroup of less
        (None, 0.8, [2000], 500, 2000),  # one without a limit
        (None, 0.8, [], 2500, MOST),
    ],
)
def test_what_a_worker_may_take(monkeypatch, limit, pause, groups, default, most):
    monkeypatch.setattr(worker, "running", lambda: Pretended(limit, pause))
    monkeypatch.setattr(worker, "cgroup_limits", lambda: groups)
    monkeypatch.setattr(worker, "default_memory", lambda: min([10_000, *groups]) // 4)
    found = worker.this_worker()
    assert found == ("worker 5 (tcp://far:1)", 3, default, most)
    asked = Asked(None, None, "tree", None, None, None, None)
    assert asked.settings(found).memory == default and asked.settings(found).threads == 3
    if most < MOST:
        with pytest.raises(BudgetError, match=r"worker 5 \(tcp://far:1\) is paused or ended"):
            dataclasses.replace(asked, memory=most + 1).settings(found)


def test_a_scratch_folder_that_a_worker_has_not(shared_client, scene, tmp_path):
    with pytest.raises(bfrt.SettingError, match=r"scratch: found .*, expected a folder that is"):
        scene.render(client=shared_client, scratch=tmp_path / "none")


# --- sessions ------------------------------------------------------------------------------------


def test_a_store_is_opened_once(shared_client, scene):
    for _ in range(2):
        scene.render(memory=MEMORY, client=shared_client)
    for opened in shared_client.run(open_stores).values():
        assert opened.count(str(scene.path)) == 1


def test_tasks_of_a_process_trace_one_after_another(scene, monkeypatch):
    """So that the budget holds, which is the process's; each has all threads of the worker."""
    made, inside, most = [], [], []
    tracer = bfrt.session.Session.tracer

    @contextmanager
    def counted(self, settings, *frame):
        made.append(settings.threads)
        inside.append(1)
        most.append(len(inside))
        time.sleep(0.01)
        with tracer(self, settings, *frame) as lent:
            yield lent
        inside.pop()

    monkeypatch.setattr(bfrt.session.Session, "tracer", counted)
    with cluster_of(1, processes=False, threads=4) as client, dask.config.set(scheduler=client):
        answer = lazily(scene, 4000, 200).compute()
    assert_same_answer(answer, scene.cast_rays(*some_rays(4000), memory=MEMORY))
    assert most[:20] == [1] * 20 and made[:20] == [4] * 20


def test_only_the_last_session_is_kept(paths):
    places = [stores.Place.of(bfrt.open(path).store) for path in paths.values()]
    settings = bfrt.settings.Settings.of(MEMORY, 1)
    opened = stores.OpenStores()
    with opened.lent(places[0]) as first, first.tracer(settings):
        pass
    assert first._kept is not None
    with opened.lent(places[1]) as second, second.tracer(settings):
        assert first._kept is None
    with opened.lent(places[0]) as again:
        assert again is first and second._kept is None
    opened.close()


def test_few_stores_stay_open(scene, monkeypatch, tmp_path):
    monkeypatch.setattr(stores, "MOST_OPEN", 2)
    opened = stores.OpenStores()
    for name in "abc":
        shutil.copytree(scene.path, tmp_path / name)
        with opened.lent(stores.Place.of(bfrt.open(tmp_path / name).store)):
            pass
    assert [place.path for place in opened._sessions] == [f"{tmp_path}/b", f"{tmp_path}/c"]
    opened.close()


def test_sessions_are_closed_when_a_worker_ends(scene):
    gc.collect()
    before = sum(name.startswith("bfrt") for name in thread_names())
    with cluster_of(1, processes=False, threads=3) as client:
        scene.render(memory=MEMORY, client=client)
        assert sum(name.startswith("bfrt") for name in thread_names()) > before
        assert open_stores() == [str(scene.path)]
    assert open_stores() == []
    wait_until(lambda: sum(name.startswith("bfrt") for name in thread_names()) <= before)


def test_a_task_that_is_cancelled_ends(paths, monkeypatch):
    """Dask itself cannot stop what runs in a thread."""
    calls = []
    call = reports.TaskReport.__call__

    def slow(self, progress):
        calls.append(progress)
        time.sleep(0.05)
        call(self, progress)

    monkeypatch.setattr(reports.TaskReport, "__call__", slow)
    scene = bfrt.open(paths["given"])
    o, d = (da.from_array(part, chunks=(200_000, 3)) for part in some_rays(200_000))
    with cluster_of(1, processes=False) as client:
        future = client.compute(scene.cast_rays(o, d, memory="64MiB", refine="base"))
        wait_until(lambda: calls)
        future.cancel()
        wait_until(lambda: not any(client.run(executing).values()))
        told = len(calls)
        assert calls[-1].done < calls[-1].total
        time.sleep(0.3)
        assert len(calls) == told
        assert not any(name == "bfrt-ahead" for name in thread_names())


def test_a_forked_process_has_stores_of_its_own(scene):
    opened = stores.OpenStores()
    held = threading.Event()
    opened._tracing.acquire()
    opened.renew()
    with opened.lent(stores.Place.of(scene.store)):
        held.set()
    assert held.is_set()
    opened.close()
