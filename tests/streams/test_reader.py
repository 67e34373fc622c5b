"""The forward-only reader gives the bytes of its file, counts them, and names what goes wrong."""

from __future__ import annotations

import errno
import itertools
import os
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from bfrt.errors import ShortReadError, StreamError
from bfrt.streams.reader import Reader, SharedFile

PAGE = 4096
DATA = bytes(range(251)) * 140  # 8.6 pages; the period is no divisor of a page


@pytest.fixture(scope="module")
def path(tmp_path_factory):
    path = tmp_path_factory.mktemp("reader") / "records"
    path.write_bytes(DATA)
    return path


def reader_of(path, capacity=PAGE, stop=None):
    reader = Reader(SharedFile(path), capacity)
    reader.window(0, reader.file.size if stop is None else stop)
    return reader


@st.composite
def windows(draw):
    """Ascending windows of DATA, each with the sizes of the records taken from its start."""
    cuts = draw(st.lists(st.integers(0, len(DATA)), min_size=2, max_size=12).map(sorted))
    sizes = st.lists(st.integers(0, PAGE), max_size=20)
    return [(begin, stop, draw(sizes)) for begin, stop in itertools.pairwise(cuts)]


@given(plan=windows(), capacity=st.sampled_from([1, PAGE, 2 * PAGE, 64 * PAGE]))
def test_takes_and_skips_against_plain_bytes(path, plan, capacity):
    reader = Reader(SharedFile(path), capacity)
    for begin, stop, sizes in plan:
        reader.window(begin, stop)
        at = begin
        for n in sizes:
            if at + n > stop:
                with pytest.raises(ShortReadError):
                    reader.read(n)
                break
            assert reader.read(n) == DATA[at : at + n]
            at += n


@given(stop=st.integers(0, 2 * PAGE))
def test_nothing_beyond_a_window_even_if_the_last_one_had_read_it(path, stop):
    reader = reader_of(path, 4 * PAGE)
    reader.read(1)
    reader.window(1, max(1, stop))
    with pytest.raises(ShortReadError):
        reader.read(max(1, stop))
    assert reader.read(max(1, stop) - 1) == DATA[1:stop]
    reader.window(max(1, stop), len(DATA))
    assert reader.read(PAGE) == DATA[max(1, stop) : max(1, stop) + PAGE]


def test_a_window_may_begin_where_the_last_one_stopped_reading(path):
    reader = reader_of(path)
    reader.window(0, 10)
    reader.read(10)
    reader.window(10, 20)
    assert reader.read(10) == DATA[10:20]


@pytest.mark.parametrize(
    ("begin", "stop"), [(99, 200), (0, 50), (150, 140), (100, len(DATA) + 1), (-1, 100)]
)
def test_backwards_or_outside_is_an_error(path, begin, stop):
    reader = reader_of(path)
    reader.read(100)
    with pytest.raises(ValueError, match="forwards only") as caught:
        reader.window(begin, stop)
    assert str(caught.value).startswith(f"{path}: window [{begin}, {stop}) from 100")
    assert reader.read(5) == DATA[100:105]


def test_rewind_begins_a_new_sweep(path):
    reader = reader_of(path)
    reader.read(100)
    reader.rewind()
    with pytest.raises(ShortReadError, match="at byte 0, found 0"):
        reader.read(1)
    reader.window(0, 10)
    assert reader.read(10) == DATA[:10]


def test_the_end_of_the_file_is_named(path):
    reader = reader_of(path)
    reader.window(len(DATA) - 3, len(DATA))
    with pytest.raises(ShortReadError) as caught:
        reader.read(4)
    assert caught.value.path == str(path)
    assert caught.value.offset == len(DATA) - 3
    assert str(caught.value).startswith(
        f"{path}: asked for 4 bytes at byte {len(DATA) - 3}, found 3"
    )
    assert reader.read(3) == DATA[-3:]


def test_more_than_the_buffer_holds_is_an_error(path):
    reader = reader_of(path, PAGE)
    assert reader.read(PAGE) == DATA[:PAGE]
    with pytest.raises(ShortReadError, match=f"asked for {PAGE + 1} bytes at byte {PAGE}"):
        reader.read(PAGE + 1)


def test_a_file_truncated_after_opening(tmp_path):
    path = tmp_path / "records"
    path.write_bytes(DATA[: 3 * PAGE])
    reader = reader_of(path)
    assert reader.read(PAGE) == DATA[:PAGE]
    os.truncate(path, PAGE + 100)
    with pytest.raises(ShortReadError) as caught:
        reader.read(200)
    assert caught.value.offset == PAGE + 100
    assert str(path) in str(caught.value)


def test_a_refused_read(tmp_path):
    file = SharedFile(tmp_path)  # a folder opens, and is not read
    if file.size == 0:
        pytest.skip("folders have no size here")
    reader = Reader(file, PAGE)
    reader.window(0, 1)
    with pytest.raises(StreamError, match="reading at byte 0") as caught:
        reader.read(1)
    assert caught.value.errno == errno.EISDIR
    assert caught.value.path == str(tmp_path)


def test_a_read_that_the_device_fails(path):
    memory = Path("/proc/self/mem")  # Linux fails reads of page 0 with EIO
    if not memory.exists():
        pytest.skip("no /proc/self/mem here")
    lowest = os.open(path, os.O_RDONLY)  # POSIX gives the lowest number that is free,
    os.close(lowest)
    file = SharedFile(path)  # so this one is the file's
    failing = os.open(memory, os.O_RDONLY)
    os.dup2(failing, lowest)
    os.close(failing)
    reader = Reader(file, PAGE)
    reader.window(0, 8)
    with pytest.raises(StreamError) as caught:
        reader.read(8)
    assert (caught.value.errno, caught.value.offset) == (errno.EIO, 0)
    assert str(caught.value).startswith(f"{path}: reading at byte 0: ")


def test_a_file_that_is_not_there(tmp_path):
    with pytest.raises(StreamError, match="opening at byte 0") as caught:
        SharedFile(tmp_path / "none")
    assert caught.value.errno == errno.ENOENT
    assert caught.value.path == str(tmp_path / "none")


def test_a_buffer_beyond_memory(path):
    with pytest.raises(MemoryError):
        Reader(SharedFile(path), 1 << 62)


def test_an_empty_file(tmp_path):
    (tmp_path / "empty").touch()
    reader = reader_of(tmp_path / "empty")
    assert reader.read(0) == b""
    with pytest.raises(ShortReadError):
        reader.read(1)
    assert reader.file.counts() == (0, 0)


def test_bytes_and_seeks_of_a_sweep_are_exact(path):
    reader = reader_of(path, PAGE)
    for at in range(0, len(DATA), 100):
        assert reader.read(min(100, len(DATA) - at)) == DATA[at : at + 100]
    assert reader.file.counts() == (len(DATA), 0)
    assert reader.file.counts() == (0, 0)


def test_bytes_and_seeks_of_windows_are_exact(path):
    reader = reader_of(path, PAGE, stop=10)
    reader.read(10)  # from 0: no seek
    reader.window(10, 30)
    reader.read(20)  # goes on: no seek
    reader.window(5 * PAGE, 5 * PAGE + 7)
    reader.read(7)  # a seek
    reader.window(5 * PAGE + 7, len(DATA))
    reader.read(1)  # no seek, and a whole buffer
    reader.window(5 * PAGE + 107, len(DATA))
    reader.read(1)  # in the buffer
    reader.rewind()
    reader.window(0, 1)
    reader.read(1)  # a seek
    assert reader.file.counts() == (10 + 20 + 7 + PAGE + 1, 2)


def test_readers_share_a_file(path):
    file = SharedFile(path)
    one, two = Reader(file, PAGE), Reader(file, PAGE)
    one.window(0, PAGE)
    two.window(PAGE, 2 * PAGE)
    assert one.read(10) == DATA[:10]
    assert two.read(10) == DATA[PAGE : PAGE + 10]  # goes on where the other ended
    assert one.read(10) == DATA[10:20]  # neither moves the other
    assert two.read(10) == DATA[PAGE + 10 : PAGE + 20]
    assert file.counts() == (2 * PAGE, 0)
    assert one.file is two.file is file


def test_a_shared_file_is_closed(path):
    lowest = [os.open(path, os.O_RDONLY) for _ in range(2)]
    for descriptor in lowest:
        os.close(descriptor)
    file = SharedFile(path, prefetched=True)
    assert [os.fstat(descriptor).st_size for descriptor in lowest] == 2 * [len(DATA)]
    del file
    for descriptor in lowest:
        with pytest.raises(OSError, match=r"[Bb]ad file"):
            os.fstat(descriptor)


def test_what_is_prefetched_is_the_same_file(path):
    reader = Reader(SharedFile(path, prefetched=True), PAGE)
    reader.rewind(prefetched=True)
    reader.window(0, len(DATA))
    assert reader.read(PAGE) == DATA[:PAGE]
    reader.expect(False)  # from here on the system reads ahead
    assert reader.read(10) == DATA[PAGE : PAGE + 10]
    reader.expect(True)
    assert reader.read(PAGE) == DATA[PAGE + 10 : 2 * PAGE + 10]


def test_a_file_that_is_read_in_order(path):
    reader = reader_of(path)
    with pytest.raises(ValueError, match=f"{path.name}: found a file that is only read in order"):
        reader.rewind(prefetched=True)


def test_records_of_two_buffers_are_whole(path):
    reader = reader_of(path, 1)  # becomes a page, of which 24 is no divisor
    for at in range(0, len(DATA) - 24, 24):
        assert reader.read(24) == DATA[at : at + 24]


def test_a_rewound_reader_begins_again(path):
    reader = reader_of(path, 4 * PAGE)
    assert reader.read(PAGE) == DATA[:PAGE]
    reader.rewind()
    with pytest.raises(ShortReadError):
        reader.read(1)
    reader.window(0, 8)
    assert reader.read(8) == DATA[:8]
