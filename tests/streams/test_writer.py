"""A file writer writes all of it, knows what it wrote, and names what goes wrong."""

from __future__ import annotations

import errno
import os
import zlib
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from bfrt.errors import DiskFullError, StreamError
from bfrt.streams.writer import BUFFER_BYTES, FileWriter, write_all


@given(sizes=st.lists(st.sampled_from([0, 1, 7, BUFFER_BYTES - 1, BUFFER_BYTES, 300_000])))
def test_bytes_and_checksum_are_those_of_the_file(tmp_path_factory, sizes):
    path = tmp_path_factory.mktemp("writer") / "a"
    blocks = [bytes([k % 256]) * n for k, n in enumerate(sizes)]
    with FileWriter(path) as file:
        for block in blocks:
            file.write(block)
    data = b"".join(blocks)
    assert path.read_bytes() == data
    assert (file.bytes, file.checksum) == (len(data), zlib.crc32(data))


@pytest.mark.parametrize("rows", [0, 3, 100_000])
def test_arrays_are_written_as_they_lie(tmp_path, rows):
    array = np.arange(rows * 6, dtype="<f4").reshape(rows, 6)
    with FileWriter(tmp_path / "a") as file:
        file.write(array)
    assert (tmp_path / "a").read_bytes() == array.tobytes()
    assert file.bytes == array.nbytes


def test_what_is_not_contiguous_is_refused(tmp_path):
    array = np.arange(1 << 18, dtype="<f4").reshape(-1, 2)
    for part in (array[:, 0], array[:4, 0]):
        file = FileWriter(tmp_path / f"{len(part)}")
        with pytest.raises((TypeError, BufferError)):
            file.write(part)
        file.abandon()


def test_gathered_bytes_are_a_copy(tmp_path):
    block = np.zeros(4, np.uint8)
    with FileWriter(tmp_path / "a") as file:
        file.write(block)
        block[:] = 9
    assert (tmp_path / "a").read_bytes() == bytes(4)


def test_short_writes_are_continued(tmp_path, monkeypatch):
    calls = []
    real = os.write

    def little(fd, data):
        calls.append(len(data))
        return real(fd, data[:1000])

    monkeypatch.setattr(os, "write", little)
    data = os.urandom(300_000)
    with FileWriter(tmp_path / "a") as file:
        file.write(data)
    assert (tmp_path / "a").read_bytes() == data
    assert len(calls) == 300
    assert file.bytes == len(data)


@pytest.mark.parametrize(
    ("number", "kind"), [(errno.ENOSPC, DiskFullError), (errno.EIO, StreamError)]
)
def test_a_refused_write_names_the_file_and_the_offset(tmp_path, monkeypatch, number, kind):
    real = os.write
    left = [500_000]

    def until_full(fd, data):
        if not left[0]:
            raise OSError(number, "no")
        n = real(fd, data[: left[0]])
        left[0] -= n
        return n

    monkeypatch.setattr(os, "write", until_full)
    file = FileWriter(tmp_path / "a")
    file.write(bytes(600_000))
    with pytest.raises(StreamError) as caught:
        file.close()
    assert type(caught.value) is kind
    assert caught.value.offset == 500_000
    assert caught.value.errno == number
    assert str(caught.value).startswith(f"{tmp_path / 'a'}: writing at byte 500000: ")


def test_a_full_disk():
    if not Path("/dev/full").exists():
        pytest.skip("no /dev/full here")
    fd = os.open("/dev/full", os.O_WRONLY)
    try:
        with pytest.raises(DiskFullError) as caught:
            write_all(fd, b"x", "spool", 77)
    finally:
        os.close(fd)
    assert caught.value.offset == 77


def test_a_file_beyond_the_limit(tmp_path):
    resource = pytest.importorskip("resource", reason="no limits of file size here")
    signal = pytest.importorskip("signal")
    old = resource.getrlimit(resource.RLIMIT_FSIZE)
    handler = signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    resource.setrlimit(resource.RLIMIT_FSIZE, (100_000, old[1]))
    try:
        with pytest.raises(StreamError) as caught, FileWriter(tmp_path / "a") as file:
            file.write(bytes(300_000))
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, old)
        signal.signal(signal.SIGXFSZ, handler)
    assert caught.value.errno == errno.EFBIG
    assert caught.value.offset == 100_000
    assert not isinstance(caught.value, DiskFullError)


def test_what_is_gathered_may_fail_at_close(tmp_path, monkeypatch):
    def full(fd, data):
        raise OSError(errno.ENOSPC, "no")

    file = FileWriter(tmp_path / "a")
    file.write(b"little")
    monkeypatch.setattr(os, "write", full)
    with pytest.raises(DiskFullError, match="writing at byte 0"):
        file.close()


def test_a_sync_may_fail(tmp_path, monkeypatch):
    def full(fd):
        raise OSError(errno.ENOSPC, "no")

    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(DiskFullError, match="syncing at byte 6"), FileWriter(tmp_path / "a") as f:
        f.write(b"little")


def test_close_makes_it_durable(tmp_path, monkeypatch):
    sizes = []
    monkeypatch.setattr(os, "fsync", lambda fd: sizes.append(os.fstat(fd).st_size))
    with FileWriter(tmp_path / "a") as file:
        file.write(b"little")
    assert sizes == [6]


def test_a_file_that_is_there_is_kept(tmp_path):
    (tmp_path / "a").write_bytes(b"old")
    with pytest.raises(StreamError, match="creating") as caught:
        FileWriter(tmp_path / "a")
    assert caught.value.errno == errno.EEXIST
    assert (tmp_path / "a").read_bytes() == b"old"


@pytest.mark.parametrize("how", ["close", "abandon", "failure"])
def test_the_file_is_closed_once(tmp_path, how, monkeypatch):
    closed = []
    real = os.close
    monkeypatch.setattr(os, "close", lambda fd: (closed.append(fd), real(fd)))
    file = FileWriter(tmp_path / "a")
    if how == "failure":
        with pytest.raises(KeyboardInterrupt), file:
            raise KeyboardInterrupt
    else:
        getattr(file, how)()
    file.abandon()
    assert len(closed) == 1


def test_a_closed_writer_takes_no_more(tmp_path):
    file = FileWriter(tmp_path / "a")
    file.close()
    with pytest.raises(StreamError):
        file.write(bytes(BUFFER_BYTES))
