"""Ranges of objects that are chosen ahead: all of them, once each, in order, by any threads."""

from __future__ import annotations

import itertools
import threading
import time

import numpy as np
import pytest

import bfrt
from bfrt.geometry.lattice import Lattice
from bfrt.phases import selection
from bfrt.phases.selection import Batch, Selections
from bfrt.phases.subspace import Subspace
from bfrt.store.hierarchy import Hierarchy
from bfrt.store.store import open_store
from bfrt.workers import Workers

EVERYWHERE = Lattice((0.0,) * 3, (1.0,) * 3, (4, 4, 4), 0.0)


@pytest.fixture
def stream(tmp_path):
    """20,000 triangles, all of them in a unit cube."""
    with bfrt.SceneWriter(tmp_path / "a.bfrt", hierarchy=Hierarchy(bits=8)) as writer:
        writer.triangles(np.random.default_rng(1).random((20_000, 3, 3), np.float32))
    (stream,) = open_store(tmp_path / "a.bfrt").streams
    return stream


@pytest.mark.parametrize("threads", [1, 4])
@pytest.mark.parametrize("ahead", [64, 1 << 17])
@pytest.mark.parametrize("dense", [0.9, 1.1])
def test_all_are_chosen_once_and_asked_for_before(stream, threads, ahead, dense, monkeypatch):
    """Unless all of a batch are chosen: then they are read in order."""
    monkeypatch.setattr(selection, "AHEAD_OBJECTS", ahead)
    monkeypatch.setattr(selection, "DENSE", dense)
    selections = Selections([stream], threads)
    for _ in range(2):  # a second pass begins anew
        asked = []
        seen = [[] for _ in range(threads)]

        def ask(ranges, asked=asked):
            asked.extend(ranges.tolist())

        where = Subspace(EVERYWHERE, 0, 4)
        choose = selections.begin(stream, EVERYWHERE, where, ask)

        def step(worker, choose=choose, seen=seen, asked=asked):
            ranges, before = choose(worker)
            assert before == (dense > 1 and len(ranges) > 0)
            parents = selections.parents[worker, : len(ranges)]
            assert (parents[:, :3] <= parents[:, 3:]).all()
            assert not before or ranges[-1].tolist() in asked
            seen[worker].extend(ranges.tolist())
            return len(ranges) > 0

        workers = Workers(threads)
        workers.repeat(step)
        workers.close()
        assert all(ranges == sorted(ranges) for ranges in seen)
        taken = np.array(sorted(itertools.chain(*seen)))
        assert taken[0, 0] == 0 and taken[-1, 1] == stream.count
        np.testing.assert_array_equal(taken[1:, 0], taken[:-1, 1])
        assert asked == (taken.tolist() if dense > 1 else [])


def test_a_walk_that_failed_is_not_gone_on_with(stream, monkeypatch):
    """Who waits for its turn then has nothing to do."""
    monkeypatch.setattr(selection, "AHEAD_OBJECTS", 64)
    selections = Selections([stream], 4)
    fills = []
    fill = Batch.fill

    def fail_later(self, *given):
        fills.append(threading.get_ident())
        if len(fills) == 5:
            time.sleep(0.05)  # the others wait for this batch meanwhile
            raise bfrt.StoreError("the fifth")
        return fill(self, *given)

    monkeypatch.setattr(Batch, "fill", fail_later)
    choose = selections.begin(stream, EVERYWHERE, Subspace(EVERYWHERE, 0, 4), lambda _: None)
    workers = Workers(4)
    with pytest.raises(bfrt.StoreError, match="the fifth"):
        workers.repeat(lambda worker: len(choose(worker)[0]) > 0)
    workers.close()
    assert len(fills) == 5
