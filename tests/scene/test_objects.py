"""Sweeps by several threads: who goes on with a walk, and when one fails."""

from __future__ import annotations

import time

import numpy as np
import pytest

import bfrt
from bfrt.scene.objects import Objects
from bfrt.workers import Workers


@pytest.fixture(params=[1, 4])
def objects(request, tmp_path):
    store = bfrt.spd.rings(3).write(tmp_path / "a.bfrt")
    workers = Workers(request.param)
    yield Objects(store, store.groups[0], workers, 4096, lazy=True)
    workers.close()


def ranges_of(count, each):
    return np.array([[i, min(count, i + each)] for i in range(0, count, each)])


def test_chosen_ranges_are_swept_once(objects):
    for stream in objects.group.streams:
        left = iter(np.array_split(ranges_of(stream.count, 7), 30))
        seen = []

        def choose(_, left=left):
            return next(left, np.empty((0, 2), np.int64))

        def loop(worker, sweep, ranges, seen=seen):
            seen.extend(i for a, b in ranges.tolist() for i in range(a, b))

        objects.begin(stream)
        assert objects.chosen(stream, choose, loop) == stream.count
        assert sorted(seen) == list(range(stream.count))


def test_who_waits_for_a_turn_that_fails_does_not_take_it(objects):
    """A walk that has failed is in no state to go on from."""
    stream = max(objects.group.streams, key=lambda s: s.count)
    calls = []

    def choose(worker):
        calls.append(worker)
        time.sleep(0.05)  # the others wait for their turn meanwhile
        raise bfrt.StoreError("the first")

    objects.begin(stream)
    with pytest.raises(bfrt.StoreError, match="the first"):
        objects.chosen(stream, choose, lambda *_: None)
    assert len(calls) == 1


def test_a_loop_that_fails_ends_the_walk(objects):
    stream = max(objects.group.streams, key=lambda s: s.count)
    left = iter(ranges_of(stream.count, 1).reshape(-1, 1, 2))
    swept = []

    def loop(worker, sweep, ranges):
        swept.append(worker)
        if len(swept) == 5:
            raise ValueError("the fifth")
        time.sleep(0.001)

    objects.begin(stream)
    with pytest.raises(ValueError, match="the fifth"):
        objects.chosen(stream, lambda _: next(left), loop)
    assert len(swept) < 20
