"""Threads are all there before work is given to them, or the one that is not is heard of."""

from __future__ import annotations

import _thread
import subprocess
import sys
import threading
import time

import pytest
from running import thread_names

import bfrt
from bfrt import threads as module
from bfrt.errors import ResourceError
from bfrt.threads import Pool, Threads


def named(expected):
    """Whether so many threads are there, now or in a moment: they end after they have told it."""
    end = time.monotonic() + 60
    while (found := thread_names().count("bfrt-tested")) != expected:
        if time.monotonic() > end:
            return False
        time.sleep(0.01 * (found > expected))
    return True


def test_calls_and_what_they_raise():
    with Pool(3, "bfrt-tested") as pool:
        assert named(3)
        assert [f.result() for f in [pool.submit(pow, 2, n) for n in range(50)]] == [
            2**n for n in range(50)
        ]
        with pytest.raises(ZeroDivisionError):
            pool.submit(lambda: 1 / 0).result()
        with pytest.raises(KeyboardInterrupt):
            pool.submit(interrupted).result()
        assert pool.submit(pow, 2, 3).result() == 8
    pool.close()
    assert named(0)


def interrupted():
    raise KeyboardInterrupt


def test_calls_that_are_not_begun_are_cancelled():
    begun, end = threading.Event(), threading.Event()
    pool = Pool(1, "bfrt-tested")
    first = pool.submit(lambda: (begun.set(), end.wait()))
    later = [pool.submit(pow, 1, 1) for _ in range(3)]
    assert begun.wait(60)
    pool.cancel()
    end.set()
    pool.close()
    assert first.done() and not first.cancelled()
    assert all(call.cancelled() for call in later)


@pytest.mark.parametrize("refused", [1, 2, 3])
def test_a_thread_that_the_system_refuses(monkeypatch, refused):
    start, asked = _thread.start_new_thread, []

    def refuse(*given):
        asked.append(given)
        if len(asked) == refused:
            raise RuntimeError("can't start new thread")
        return start(*given)

    monkeypatch.setattr(_thread, "start_new_thread", refuse)
    with pytest.raises(ResourceError, match=f"no room for thread {refused} of 3 .bfrt-tested"):
        Pool(3, "bfrt-tested")
    assert named(0)


def test_a_thread_that_finds_no_memory_for_its_stack(monkeypatch):
    def none():
        raise MemoryError

    monkeypatch.setattr(module, "_begin", none)
    with pytest.raises(ResourceError, match="no room for thread 1 of 2"):
        Pool(2, "bfrt-tested")


def refuse_all(*_):
    raise RuntimeError("can't start new thread")


def test_threads_that_could_not_be_started_are_started_later(monkeypatch):
    lazy = Threads(2, "bfrt-tested")
    assert named(0)
    with monkeypatch.context() as now, pytest.raises(ResourceError):
        now.setattr(_thread, "start_new_thread", refuse_all)
        lazy.submit(pow, 2, 2)
    assert lazy.submit(pow, 2, 2).result() == 4
    assert named(2)
    lazy._pool.close()


def test_a_pool_that_nobody_has_any_more_ends():
    pool = Pool(2, "bfrt-tested")
    told = pool._told
    del pool
    assert [told.get(timeout=60) for _ in range(2)] == [None, None]


KEPT = """
import gc, sys
import numpy as np
import bfrt

class Cycle:
    pass

gc.disable()
cycle = Cycle()
cycle.scene = bfrt.open(sys.argv[1])
cycle.itself = cycle
cycle.scene.cast_rays(np.zeros((1, 3)), np.ones((1, 3)), threads=3, refine=sys.argv[2])
cycle.file = bfrt.SceneWriter(sys.argv[3])
"""


@pytest.mark.parametrize("refine", ["sgb", "tree"])
def test_an_open_scene_does_not_keep_the_interpreter_from_its_end(tmp_path, refine):
    store = bfrt.spd.rings(3).write(tmp_path / "a.bfrt", order="spatial").path
    command = [sys.executable, "-c", KEPT, str(store), refine, str(tmp_path / "b.bfrt")]
    ended = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, timeout=60)
    assert (ended.returncode, ended.stderr) == (0, "")
    assert [path.name for path in tmp_path.iterdir()] == ["a.bfrt"]
