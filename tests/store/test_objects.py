"""Sweeps by several threads: who goes on with a walk, and when one fails."""

from __future__ import annotations

import ctypes
import mmap
import sys
import threading
import time

import numpy as np
import pytest
from capped import drop

import bfrt
from bfrt.store.objects import Objects
from bfrt.store.store import open_store
from bfrt.workers import Workers


@pytest.fixture(params=[1, 4])
def objects(request, tmp_path):
    store = bfrt.spd.rings(3).write(tmp_path / "a.bfrt").store
    workers = Workers(request.param)
    yield Objects(store, store.groups[0], workers, 4096, lazy=True)
    workers.close()


def ranges_of(count, each):
    return np.array([[i, min(count, i + each)] for i in range(0, count, each)])


@pytest.mark.parametrize("asked", [True, False])
def test_chosen_ranges_are_swept_once(objects, asked):
    for stream in objects.group.streams:
        left = iter(np.array_split(ranges_of(stream.count, 7), 30))
        turn = threading.Lock()
        seen = []

        def choose(_, left=left, turn=turn):
            with turn:
                return next(left, np.empty((0, 2), np.int64)), asked

        def loop(worker, sweep, ranges, seen=seen):
            seen.extend(i for a, b in ranges.tolist() for i in range(a, b))

        objects.begin_chosen(stream)
        assert objects.chosen(stream, choose, loop) == stream.count
        assert sorted(seen) == list(range(stream.count))


def test_a_loop_that_fails_ends_the_walk(objects):
    stream = max(objects.group.streams, key=lambda s: s.count)
    left = iter(ranges_of(stream.count, 1).reshape(-1, 1, 2))
    turn = threading.Lock()
    swept = []

    def choose(_):
        with turn:
            return next(left), True

    def loop(worker, sweep, ranges):
        swept.append(worker)
        if len(swept) == 5:
            raise ValueError("the fifth")
        time.sleep(0.001)

    objects.begin_chosen(stream)
    with pytest.raises(ValueError, match="the fifth"):
        objects.chosen(stream, choose, loop)
    assert len(swept) < 20


def cached(path):
    """Which pages of a file are in the page cache; to look does not bring them there."""
    size = path.stat().st_size
    found = (ctypes.c_ubyte * -(-size // mmap.PAGESIZE))()
    with path.open("rb") as file, mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_COPY) as memory:
        start = ctypes.c_char.from_buffer(memory)
        status = ctypes.CDLL(None).mincore(ctypes.byref(start), ctypes.c_size_t(size), found)
        del start
    assert status == 0
    return np.frombuffer(found, np.uint8) & 1 == 1


def dropped(path):
    """Whether a file's pages have left the page cache; those in use stay for a while."""
    for _ in range(100):
        drop(path)
        if not cached(path).any():
            return True
        time.sleep(0.01)
    return False


@pytest.mark.skipif(sys.platform != "linux", reason="Linux is asked, and tells what is cached")
def test_boxes_that_are_asked_for_come(tmp_path):
    """And what lies between them does not."""
    with bfrt.SceneWriter(tmp_path / "a.bfrt") as writer:
        writer.triangles(np.random.default_rng(1).random((200_000, 3, 3), np.float32))
    store = open_store(tmp_path / "a.bfrt")
    (stream,) = store.streams
    path = stream.path("quantised")
    if not dropped(path):
        pytest.skip("this file system does not drop a file's pages")
    workers = Workers(1)
    objects = Objects(store, store.groups[0], workers, 4096, lazy=True)
    objects.begin_chosen(stream)(np.array([[10, 20], [100_000, 110_000], [150_000, 150_100]]))
    workers.close()
    deadline = time.monotonic() + 60
    for first, end in ((60, 120), (600_000, 660_000), (900_000, 900_600)):
        while not cached(path)[first // mmap.PAGESIZE : -(-end // mmap.PAGESIZE)].all():
            assert time.monotonic() < deadline
            time.sleep(0.01)
    for between in (300_000, 1_140_000):
        assert not cached(path)[between // mmap.PAGESIZE]
