"""Hits by object: in loads that fit memory, of a whole order where that saves reading."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from bfrt.phases.picking import by_object
from bfrt.records import HIT, INDEX_BITS
from bfrt.streams.spool import Spool

RNG = np.random.default_rng(8)

#: Streams' numbers and counts.
COUNTS = {1: 50, 2: 900, 7: 30}


def groups(lazy=True, record=1000):
    """Two groups as by_object sees them, of objects of so many bytes."""
    streams = [
        SimpleNamespace(number=n, count=c, expected_bytes=lambda c=c: {"geometry": c * record})
        for n, c in COUNTS.items()
    ]
    return [
        SimpleNamespace(lazy=lazy, group=SimpleNamespace(streams=some))
        for some in (streams[:2], streams[2:])
    ]


@pytest.fixture
def hits(tmp_path):
    """2,000 hits, a third of them on one object."""
    spool = Spool(HIT, 100, tmp_path)
    records = np.zeros(2000, HIT)
    streams = RNG.choice(list(COUNTS), 2000)
    index = RNG.integers(0, np.vectorize(COUNTS.get)(streams))
    records["id"] = streams.astype(np.uint64) << np.uint64(INDEX_BITS) | index.astype(np.uint64)
    records["id"][::3] = 7 << INDEX_BITS | 3
    records["t"] = np.arange(2000)
    spool.append(records)
    yield spool, records
    spool.close()


@pytest.mark.parametrize("room", [7, 150, 5000])
@pytest.mark.parametrize(("lazy", "record"), [(True, 1000), (True, 1), (False, 1000)])
def test_all_hits_come_in_loads_by_object(hits, room, lazy, record):
    spool, records = hits
    loads = [load.copy() for load in by_object(spool, groups(lazy, record), room)]
    assert len(spool) == 0
    assert all(0 < len(load) <= room for load in loads)
    assert all((np.diff(load["id"].astype(np.int64)) >= 0).all() for load in loads)
    found = np.concatenate(loads)
    np.testing.assert_array_equal(np.sort(found["t"]), records["t"])
    np.testing.assert_array_equal(found["id"], records["id"][found["t"].astype(int)])
    whole = room == 5000 or (lazy and record == 1000)
    assert (np.diff(found["id"].astype(np.int64)) >= 0).all() == whole
    if not whole:
        assert len(loads) == -(-2000 // room)


def test_few_hits_are_not_moved(hits):
    spool, _ = hits
    spool.counts()
    list(by_object(spool, groups(), 5000))
    assert spool.counts()[1] == 0


def test_no_hits(tmp_path):
    assert list(by_object(Spool(HIT, 5, tmp_path), groups(), 5)) == []
