"""Work sources: all objects, chosen ones, picked ones; each once, in order, by any threads."""

from __future__ import annotations

import ctypes
import itertools
import mmap
import sys
import threading
import time

import numpy as np
import pytest
from capped import drop

import bfrt
from bfrt.grid.grid import Grid
from bfrt.grid.selection import Selection
from bfrt.grid.subspace import Subspace
from bfrt.scan import sources
from bfrt.scan.scans import GroupScans
from bfrt.scan.sources import (
    AllObjects,
    AllRecords,
    Batch,
    Batches,
    ChosenObjects,
    PickedObjects,
)
from bfrt.store.hierarchy import Hierarchy
from bfrt.store.store import open_store
from bfrt.workers import Workers

EVERYWHERE = Grid((0.0,) * 3, (1.0,) * 3, (4, 4, 4), 0.0)


@pytest.fixture(params=[1, 4])
def workers(request):
    made = Workers(request.param)
    yield made
    made.close()


@pytest.fixture
def rings(tmp_path):
    return bfrt.spd.rings(3).write(tmp_path / "a.bfrt").store


@pytest.fixture
def store(tmp_path):
    """20,000 triangles, all of them in a unit cube."""
    with bfrt.SceneWriter(
        tmp_path / "b.bfrt", hierarchy=Hierarchy(bits=8), order="given"
    ) as writer:
        writer.triangles(np.random.default_rng(1).random((20_000, 3, 3), np.float32))
    return open_store(tmp_path / "b.bfrt")


def scans_of(store, workers, lazy=True):
    return GroupScans(store, store.groups[0], workers.threads, 4096, lazy)


class Given:
    """Chooses ranges that are given, a few at a time, whatever is asked for."""

    def __init__(self, ranges):
        few = max(1, len(ranges) // 30)
        self.left = (ranges[first : first + few] for first in range(0, len(ranges), few))

    def choose(self, ranges, objects, parents):
        some = next(self.left, ranges[:0])
        ranges[: len(some)] = some
        return len(some)


@pytest.mark.parametrize("lazy", [True, False])
@pytest.mark.parametrize("kind", [AllObjects, AllRecords])
def test_all_objects_come_once(rings, workers, kind, lazy):
    scans = scans_of(rings, workers, lazy)
    for stream in rings.streams:
        seen = [[] for _ in range(workers.threads)]
        source = kind(scans, stream)
        workers.drain(source, lambda worker, chunk, seen=seen: seen[worker].extend(chunk.ranges))
        assert source.swept == stream.count
        assert all((np.diff([r[0] for r in own]) > 0).all() for own in seen)
        ends = sorted(map(tuple, itertools.chain(*seen)))
        assert [a for a, _ in ends] == [0, *(b for _, b in ends[:-1])] and ends[-1][
            1
        ] == stream.count


@pytest.mark.parametrize("lazy", [True, False])
def test_picked_objects_come_once(rings, workers, lazy):
    scans = scans_of(rings, workers, lazy)
    for stream in rings.streams:
        picked = np.arange(0, stream.count, 3)
        seen = []
        source = PickedObjects(scans, stream, picked)
        workers.drain(
            source, lambda _, chunk, seen=seen, picked=picked: seen.extend(picked[chunk[1]])
        )
        assert sorted(seen) == picked.tolist()


def test_chosen_objects_come_once(rings, workers):
    scans, batches = scans_of(rings, workers), Batches(workers.threads)
    for stream in rings.streams:
        ranges = np.array([[i, min(stream.count, i + 7)] for i in range(0, stream.count, 7)])
        seen = []
        source = ChosenObjects(scans, stream, Given(ranges), batches)
        workers.drain(
            source,
            lambda _, chunk, seen=seen: seen.extend(
                i for a, b in chunk.ranges for i in range(a, b)
            ),
        )
        assert source.swept == stream.count
        assert sorted(seen) == list(range(stream.count))


@pytest.mark.parametrize("ahead", [64, 1 << 17])
@pytest.mark.parametrize("dense", [0.9, 1.1])
def test_all_are_chosen_once_and_prefetched(store, workers, ahead, dense, monkeypatch):
    """Unless all of a batch are chosen: then they are read in order."""
    monkeypatch.setattr(sources, "AHEAD_OBJECTS", ahead)
    monkeypatch.setattr(sources, "DENSE", dense)
    scans = scans_of(store, workers)
    selection = Selection(scans, workers.threads, hierarchy=True)
    (stream,) = store.streams
    for _ in range(2):  # a second pass begins anew
        chosen = []
        fill = Batch.fill

        def filled(batch, *given, fill=fill, chosen=chosen):
            ranges = fill(batch, *given)
            assert batch.prefetched == (dense > 1 and len(ranges) > 0)
            chosen.extend(ranges.tolist())
            return ranges

        monkeypatch.setattr(Batch, "fill", filled)
        seen = [[] for _ in range(workers.threads)]
        source = selection.near(stream, EVERYWHERE, Subspace(EVERYWHERE, 0, 4))

        def meet(worker, chunk, seen=seen, chosen=chosen):
            assert (chunk.parents[:, :3] <= chunk.parents[:, 3:]).all()
            assert chunk.ranges[-1].tolist() in chosen
            seen[worker].extend(chunk.ranges.tolist())

        workers.drain(source, meet)
        monkeypatch.setattr(Batch, "fill", fill)
        assert all(ranges == sorted(ranges) for ranges in seen)
        taken = np.array(sorted(itertools.chain(*seen)))
        assert taken[0, 0] == 0 and taken[-1, 1] == stream.count
        np.testing.assert_array_equal(taken[1:, 0], taken[:-1, 1])
        assert chosen == taken.tolist()


def test_a_walk_that_failed_is_not_gone_on_with(store, monkeypatch):
    """Who waits for its turn then has nothing to do."""
    monkeypatch.setattr(sources, "AHEAD_OBJECTS", 64)
    workers = Workers(4)
    scans = scans_of(store, workers)
    fills = []
    fill = Batch.fill

    def fail_later(self, *given):
        fills.append(threading.get_ident())
        if len(fills) == 5:
            time.sleep(0.05)  # the others wait for this batch meanwhile
            raise bfrt.StoreError("the fifth")
        return fill(self, *given)

    monkeypatch.setattr(Batch, "fill", fail_later)
    selection = Selection(scans, 4, hierarchy=True)
    source = selection.near(store.streams[0], EVERYWHERE, Subspace(EVERYWHERE, 0, 4))
    with pytest.raises(bfrt.StoreError, match="the fifth"):
        workers.drain(source, lambda worker, chunk: None)
    workers.close()
    assert len(fills) == 5


def test_work_that_fails_ends_the_sweep(rings, workers):
    scans, batches = scans_of(rings, workers), Batches(workers.threads)
    stream = max(rings.streams, key=lambda s: s.count)
    ranges = np.arange(stream.count)[:, None] + [0, 1]
    swept = []

    def meet(worker, chunk):
        swept.append(worker)
        if len(swept) == 5:
            raise ValueError("the fifth")
        time.sleep(0.001)

    chooser = Given(ranges)
    chooser.left = iter(ranges.reshape(-1, 1, 2))
    with pytest.raises(ValueError, match="the fifth"):
        workers.drain(ChosenObjects(scans, stream, chooser, batches), meet)
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
def test_boxes_that_are_prefetched_come(tmp_path):
    """And what lies between them does not."""
    with bfrt.SceneWriter(tmp_path / "a.bfrt", order="given") as writer:
        writer.triangles(np.random.default_rng(1).random((200_000, 3, 3), np.float32))
    store = open_store(tmp_path / "a.bfrt")
    (stream,) = store.streams
    path = stream.path("quantised")
    if not dropped(path):
        pytest.skip("this file system does not drop a file's pages")
    scans = GroupScans(store, store.groups[0], 1, 4096, lazy=True)
    (scan,) = scans.begin(stream, prefetched=True)
    scan.boxes.prefetch(np.array([[10, 20], [100_000, 110_000], [150_000, 150_100]]))
    deadline = time.monotonic() + 60
    for first, end in ((60, 120), (600_000, 660_000), (900_000, 900_600)):
        while not cached(path)[first // mmap.PAGESIZE : -(-end // mmap.PAGESIZE)].all():
            assert time.monotonic() < deadline
            time.sleep(0.01)
    for between in (300_000, 1_140_000):
        assert not cached(path)[between // mmap.PAGESIZE]
