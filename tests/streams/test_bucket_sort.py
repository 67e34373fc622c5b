"""Spools parted by a number of their records: all of them, in ascending ranges."""

from __future__ import annotations

import itertools
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from bfrt.streams import bucket_sort
from bfrt.streams.bucket_sort import buckets_of, gathered, parted
from bfrt.streams.spool import Spool

RECORD = np.dtype([("number", "<i8"), ("order", "<i8")])


def numbers(records):
    return records["number"]


def spool_of(values, room, folder):
    spool = Spool(RECORD, room, Path(folder))
    records = np.zeros(len(values), RECORD)
    records["number"], records["order"] = values, np.arange(len(values))
    spool.append(records)
    return spool


def loads(spool, first, last, room):
    """The parts, as arrays; each is emptied, as callers do."""
    for part in buckets_of(spool, numbers, first, last, room):
        yield gathered(part, len(part))
        assert len(part) == 0


@given(
    st.lists(st.integers(-7, 300), max_size=200),
    st.integers(1, 20),
    st.integers(0, 30),
    st.integers(2, 5),
)
def test_parts_ascend_and_fit(values, room, memory, parts):
    with TemporaryDirectory() as folder, pytest.MonkeyPatch.context() as patch:
        patch.setattr(bucket_sort, "PARTS", parts)
        spool = spool_of(values, memory, folder)
        found = list(loads(spool, -7, 301, room))
        assert len(spool) == 0
        spool.close()
        assert not list(Path(folder).iterdir())
    for part in found:
        assert 0 < len(part) <= room or len(set(part["number"])) == 1
    for before, after in itertools.pairwise(found):
        assert before["number"].max() < after["number"].min()
    together = np.concatenate([np.zeros(0, RECORD), *found])
    assert sorted(together["order"]) == list(range(len(values)))
    assert together["number"].tolist() == [values[i] for i in together["order"]]


def test_parted_once(tmp_path, monkeypatch):
    monkeypatch.setattr(bucket_sort, "PARTS", 4)
    spool = spool_of([*range(40)] * 5, 0, tmp_path)
    parts = parted(spool, numbers, 0, 40, 10)
    found = [gathered(part, 999) for part in parts]
    assert [len(part) for part in found] == [50] * 4
    assert [set(part["number"]) for part in found] == [
        {*range(first, first + 10)} for first in range(0, 40, 10)
    ]
    for part in parts:
        part.close()
    spool.close()


def test_what_fits_is_not_moved(tmp_path):
    spool = spool_of(range(10), 4, tmp_path)
    spool.counts()
    assert [part is spool for part in buckets_of(spool, numbers, 0, 10, 10)] == [True]
    assert spool.counts() == (0, 0, 0)
    spool.close()


def test_bytes_of_parts_are_counted(tmp_path):
    spool = spool_of(range(100), 0, tmp_path)
    assert spool.counts() == (0, 1600, 0)
    assert sum(map(len, loads(spool, 0, 100, 50))) == 100
    read, written, _ = spool.counts()
    assert (read, written) == (3200, 1600)
    spool.close()


def test_a_reader_that_stops_leaves_nothing_open(tmp_path, monkeypatch):
    made = []
    beside = Spool.beside
    monkeypatch.setattr(Spool, "beside", lambda self: made.append(beside(self)) or made[-1])
    spool = spool_of(range(100), 0, tmp_path)
    parts = buckets_of(spool, numbers, 0, 100, 10)
    next(parts)
    parts.close()
    assert made and all(part._file is None for part in made)
    spool.close()
