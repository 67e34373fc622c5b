"""Hits by object: in loads that fit memory, of a whole order where that saves reading."""

from __future__ import annotations

import tracemalloc
from contextlib import closing
from types import SimpleNamespace

import numpy as np
import pytest

from bfrt.phases.hit_order import HitLoads
from bfrt.phases.shading import SHADED_HIT_BYTES
from bfrt.records import HIT, INDEX_BITS
from bfrt.streams.spool import Spool

RNG = np.random.default_rng(8)

#: Streams' numbers and counts.
COUNTS = {1: 50, 2: 900, 7: 30}


def groups(lazy=True, record=1000):
    """Two groups as HitLoads sees them, of objects of so many bytes."""
    streams = [
        SimpleNamespace(number=n, count=c, expected_bytes=lambda c=c: {"geometry": c * record})
        for n, c in COUNTS.items()
    ]
    return [SimpleNamespace(lazy=lazy, streams=some) for some in (streams[:2], streams[2:])]


@pytest.fixture
def hits(tmp_path):
    """2,000 hits, a third of them on the last object."""
    spool = Spool(HIT, 100, tmp_path)
    records = np.zeros(2000, HIT)
    streams = RNG.choice(list(COUNTS), 2000)
    index = RNG.integers(0, np.vectorize(COUNTS.get)(streams))
    records["id"] = streams.astype(np.uint64) << np.uint64(INDEX_BITS) | index.astype(np.uint64)
    records["id"][::3] = 7 << INDEX_BITS | 29
    records["t"] = np.arange(2000)
    spool.append(records)
    yield spool, records
    spool.close()


@pytest.mark.parametrize("room", [7, 150, 5000])
@pytest.mark.parametrize(("lazy", "record"), [(True, 1000), (True, 1), (False, 1000)])
def test_all_hits_come_in_loads_HitLoads(hits, room, lazy, record):
    spool, records = hits
    found = ((load.copy(), new) for load, new in HitLoads(spool, groups(lazy, record), room))
    loads, begins = zip(*found, strict=True)
    assert len(spool) == 0
    assert all(0 < len(load) <= room for load in loads)
    assert all((np.diff(load["id"].astype(np.int64)) >= 0).all() for load in loads)
    found = np.concatenate(loads)
    np.testing.assert_array_equal(np.sort(found["t"]), records["t"])
    np.testing.assert_array_equal(found["id"], records["id"][found["t"].astype(int)])
    if room == 5000 or (lazy and record == 1000):
        # One sweep but for crowds, which come in several loads of neighboring objects.
        firsts = np.cumsum([0, *COUNTS.values()])[:-1]
        starts = dict(zip(COUNTS, firsts, strict=True))
        streams = (found["id"] >> np.uint64(INDEX_BITS)).astype(int)
        places = np.vectorize(starts.get)(streams) + (found["id"] & np.uint64(0xFFFF)).astype(int)
        assert (np.diff(places // -(-sum(COUNTS.values()) // 64)) >= 0).all() or room == 5000
        assert (np.diff(found["id"].astype(np.int64)) < 0).sum() == sum(begins) - 1
    else:
        assert len(loads) == -(-2000 // room) and sum(begins) > len(loads) / 2


def test_few_hits_are_not_moved(hits):
    spool, _ = hits
    spool.counts()
    list(HitLoads(spool, groups(), 5000))
    assert spool.counts()[1] == 0


@pytest.mark.parametrize("record", [1, 1000])
def test_loads_take_what_the_plan_says(tmp_path, record):
    room = 20000
    with closing(Spool(HIT, room, tmp_path)) as spool:
        for _ in range(5):
            records = np.zeros(room, HIT)
            records["id"] = (2 << INDEX_BITS) + RNG.integers(0, COUNTS[2], room).astype(np.uint64)
            spool.append(records)
        del records
        tracemalloc.start()
        try:
            loads = 0
            for load, _ in HitLoads(spool, groups(record=record), room):
                ids = np.ascontiguousarray(load["id"])  # as phases do
                assert (np.diff(ids.astype(np.int64)) >= 0).all()
                loads += 1
            peak = tracemalloc.get_traced_memory()[1]
        finally:
            tracemalloc.stop()
    assert loads >= 5
    assert peak <= room * SHADED_HIT_BYTES + (1 << 18)


def test_no_hits(tmp_path):
    assert list(HitLoads(Spool(HIT, 5, tmp_path), groups(), 5)) == []
