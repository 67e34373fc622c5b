"""A spool gives its records back in order, from memory and from disk, and leaves nothing."""

from __future__ import annotations

import errno
import os
import tempfile
import threading
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from bfrt.errors import DiskFullError, ShortReadError, StreamError
from bfrt.streams import spool as spool_module
from bfrt.streams.spool import Spool

RECORD = np.dtype([("number", "<u8"), ("part", "<u4")])


def records(first, n):
    made = np.zeros(n, RECORD)
    made["number"] = np.arange(first, first + n)
    made["part"] = made["number"] * 7
    return made


@pytest.fixture
def scratch(tmp_path):
    """A folder that is empty again after the test."""
    yield tmp_path
    assert not any(tmp_path.iterdir())


@pytest.mark.parametrize("room", [0, 1, 7, 20, 100])
def test_what_waits_is_looked_at_and_left(scratch, room, monkeypatch):
    """It can be another spool's, whatever memory that has; nothing of it is counted."""
    monkeypatch.setattr(spool_module, "LOOKED_AT_BYTES", 3 * RECORD.itemsize)
    spool, other = Spool(RECORD, room, scratch), Spool(RECORD, 9, scratch)
    spool.append(records(0, 13))
    assert len(spool.read(5)) + len(spool.read(1)) > 1
    spool.append(records(13, 10))
    taken = 23 - len(spool)
    spool.counts()
    for _ in range(2):
        blocks = list(spool.waiting())
        assert np.concatenate(blocks)["number"].tolist() == [*range(taken, 23)]
    assert spool.counts() == (0, 0, 0)
    other.append(records(50, 3))
    other.restore(spool.waiting())
    assert other.counts() == (0, 0, 0) and len(other) == len(spool)
    for each in (spool, other):
        found = []
        while len(each):
            found += each.read(4)["number"].tolist()
        assert found == [*range(taken, 23)]
        assert list(each.waiting()) == []
        each.close()


@pytest.fixture(autouse=True)
def grows_soon(monkeypatch):
    """Memory that is taken a few records at a time, as that of large spools is."""
    monkeypatch.setattr(spool_module, "FIRST", 2)


@given(
    room=st.integers(0, 30),
    steps=st.lists(st.tuples(st.booleans(), st.integers(0, 20)), max_size=30),
)
def test_first_in_first_out(room, steps):
    appended = taken = 0
    with tempfile.TemporaryDirectory() as folder:
        spool = Spool(RECORD, room, Path(folder))
        for append, n in steps:
            if append:
                spool.append(records(appended, n))
                appended += n
            else:
                got = spool.read(n)
                assert got.dtype == RECORD
                assert len(got) <= n
                assert len(got) > 0 or n == 0 or taken == appended
                np.testing.assert_array_equal(got, records(taken, len(got)))
                taken += len(got)
            assert len(spool) == appended - taken
        while len(spool):
            got = spool.read(1000)
            np.testing.assert_array_equal(got, records(taken, len(got)))
            taken += len(got)
        assert taken == appended
        spool.close()
        assert os.listdir(folder) == []  # noqa: PTH208


def test_counts_are_exact(scratch):
    size = RECORD.itemsize
    spool = Spool(RECORD, 10, scratch)
    spool.append(records(0, 10))
    assert spool.counts() == (0, 0, 0)
    spool.append(records(10, 5))
    spool.append(records(15, 5))
    assert spool.counts() == (0, 10 * size, 0)
    assert len(spool.read(100)) == 10
    assert spool.counts() == (0, 0, 0)
    spool.read(3)  # a seek, from the end of what was written
    spool.read(3)
    assert spool.counts() == (6 * size, 0, 1)
    spool.append(records(20, 1))
    spool.read(100)  # a seek back
    assert spool.counts() == (5 * size, size, 1)
    spool.close()


def test_nothing_to_read(scratch):
    for room in (0, 3):
        spool = Spool(RECORD, room, scratch)
        spool.append(records(0, room))
        spool.read(room)
        assert len(spool.read(5)) == 0
        assert spool.read(5).dtype == RECORD
        assert spool.counts() == (0, 0, 0)


def test_clear_and_use_again(scratch):
    spool = Spool(RECORD, 4, scratch)
    for first in (0, 100):
        spool.append(records(first, 10))
        np.testing.assert_array_equal(spool.read(100), records(first, 4))
        np.testing.assert_array_equal(spool.read(2), records(first + 4, 2))
        spool.clear()
        assert len(spool) == 0
        assert len(spool.read(1)) == 0
    spool.close()
    spool.close()


def test_what_is_read_from_memory_is_not_copied(scratch):
    spool = Spool(RECORD, 20, scratch)
    spool.append(records(0, 21))
    one, two, last = spool.read(10), spool.read(15), spool.read(1)
    assert one.base is two.base is not None
    assert last.base is None
    np.testing.assert_array_equal(np.concatenate([one, two, last]), records(0, 21))
    spool.close()


def test_what_was_appended_is_a_copy(scratch):
    spool = Spool(RECORD, 2, scratch)
    given = records(0, 4)
    spool.append(given)
    given["number"] = 99
    np.testing.assert_array_equal(spool.read(2), records(0, 2))
    np.testing.assert_array_equal(spool.read(2), records(2, 2))
    spool.close()


def test_strided_records(scratch):
    spool = Spool(RECORD, 2, scratch)
    spool.append(records(0, 20)[::2])
    got = np.concatenate([spool.read(2), spool.read(100)])
    np.testing.assert_array_equal(got, records(0, 20)[::2])
    spool.close()


def test_records_of_another_kind_are_refused(scratch):
    spool = Spool(RECORD, 2, scratch)
    with pytest.raises(TypeError, match="expected"):
        spool.append(np.zeros(1, np.uint64))
    assert len(spool) == 0


def test_threads_append_whole_blocks(scratch):
    spool = Spool(RECORD, 500, scratch)
    threads = [
        threading.Thread(
            target=lambda k=k: [spool.append(records(k * 1000 + 10 * i, 10)) for i in range(50)]
        )
        for k in range(4)
    ]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert len(spool) == 2000
    parts = []
    while len(spool):
        parts.append(spool.read(333).copy())
    got = np.concatenate(parts)
    spool.close()
    blocks = got["number"].reshape(-1, 10)
    assert (np.diff(blocks, axis=1) == 1).all()  # no block is torn
    for k in range(4):  # each thread's own are in its order
        own = blocks[blocks[:, 0] // 1000 == k, 0]
        np.testing.assert_array_equal(own, k * 1000 + 10 * np.arange(50))
    np.testing.assert_array_equal(got["part"], got["number"] * 7)


def test_the_file_has_no_name(scratch):
    spool = Spool(RECORD, 0, scratch)
    spool.append(records(0, 100))
    assert not any(scratch.iterdir())
    spool.close()


@pytest.mark.parametrize(
    ("number", "kind"), [(errno.ENOSPC, DiskFullError), (errno.EIO, StreamError)]
)
def test_a_refused_write(scratch, monkeypatch, number, kind):
    real = os.write
    done = [0]

    def until_full(fd, data):
        if done[0] >= 60:
            raise OSError(number, "no")
        n = real(fd, data[: 60 - done[0]])
        done[0] += n
        return n

    monkeypatch.setattr(os, "write", until_full)
    spool = Spool(RECORD, 1, scratch)
    with pytest.raises(StreamError) as caught:
        spool.append(records(0, 100))
    assert type(caught.value) is kind
    assert caught.value.offset == 60
    assert str(caught.value).startswith(f"{scratch / 'spool'}: writing at byte 60: ")
    spool.close()


def test_short_writes_are_continued(scratch, monkeypatch):
    real = os.write
    monkeypatch.setattr(os, "write", lambda fd, data: real(fd, data[:7]))
    spool = Spool(RECORD, 1, scratch)
    spool.append(records(0, 100))
    spool.read(1)
    np.testing.assert_array_equal(spool.read(99), records(1, 99))
    spool.close()


def test_an_interrupt_leaves_nothing(scratch, monkeypatch):
    def interrupted(fd, data):
        raise KeyboardInterrupt

    monkeypatch.setattr(os, "write", interrupted)
    spool = Spool(RECORD, 1, scratch)
    with pytest.raises(KeyboardInterrupt):
        spool.append(records(0, 100))
    assert len(spool) == 0
    spool.close()


def test_a_folder_that_is_not_there(tmp_path):
    spool = Spool(RECORD, 1, tmp_path / "none")
    with pytest.raises(StreamError, match="creating") as caught:
        spool.append(records(0, 2))
    assert caught.value.errno == errno.ENOENT
    assert str(tmp_path / "none") in str(caught.value)


def test_a_spool_that_lost_its_bytes(scratch, monkeypatch):
    made = []
    real = spool_module.nameless

    def remember(*where):
        made.append(real(*where))
        return made[0]

    monkeypatch.setattr(spool_module, "nameless", remember)
    spool = Spool(RECORD, 0, scratch)
    spool.append(records(0, 10))
    made[0].truncate(50)
    with pytest.raises(ShortReadError) as caught:
        spool.read(10)
    assert caught.value.offset == 50
    spool.close()


def test_a_closed_spool_is_not_read(scratch):
    spool = Spool(RECORD, 0, scratch)
    spool.append(records(0, 10))
    spool.close()
    with pytest.raises(ValueError, match="after close"):
        spool.read(1)


@given(room=st.integers(0, 1000), blocks=st.lists(st.integers(0, 300), max_size=12))
def test_memory_grows_with_what_comes(room, blocks):
    """Up to the room, in steps of which a copy takes no more memory than the room."""
    with tempfile.TemporaryDirectory() as folder:
        spool, come, sizes = Spool(RECORD, room, Path(folder)), 0, []
        for n in blocks:
            spool.append(records(come, n))
            come += n
            size = len(spool._memory)
            assert min(come, room) <= size <= max(min(room, 4 * come), 7)
            assert not sizes or size == sizes[-1] or size >= 4 * sizes[-1]
            sizes.append(size)
        got = [spool.read(50) for _ in range(come + 1)]
        np.testing.assert_array_equal(np.concatenate(got), records(0, come))
        spool.close()


def test_room_beyond_the_machines_memory_is_not_taken(scratch):
    spool = Spool(RECORD, 1 << 55, scratch)
    spool.append(records(0, 10))
    np.testing.assert_array_equal(spool.read(20), records(0, 10))
