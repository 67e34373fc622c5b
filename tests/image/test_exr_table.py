"""A file whose table of chunks, or whose last chunk, was lost is found when it is read back."""

from __future__ import annotations

import errno

import numpy as np
import pytest

from bfrt.errors import StreamError
from bfrt.image.exr import write_exr
from bfrt.image.exr_table import check_chunks

HEIGHT = 45


@pytest.fixture
def whole(tmp_path):
    """A file of three chunks, its bytes, and where its table begins."""
    path = tmp_path / "a.exr"
    pixels = np.random.default_rng(1).random((HEIGHT, 20), np.float32)
    write_exr(path, 20, HEIGHT, [dict.fromkeys("RGBA", pixels)], {"scene": "made up"})
    data = path.read_bytes()
    first = next(
        at
        for at in range(len(data) - 24)
        if int.from_bytes(data[at : at + 8], "little") == at + 3 * 8
    )
    return path, data, first


def refusal(path, data):
    path.write_bytes(data)
    with pytest.raises(StreamError, match=r"b\.exr: writing a table of chunks") as caught:
        check_chunks(path, HEIGHT, "b.exr")
    assert caught.value.errno == errno.EIO
    return caught.value.offset


def test_a_whole_file(whole):
    check_chunks(whole[0], HEIGHT, "b.exr")


@pytest.mark.parametrize("number", [0, 1, 2])
def test_an_offset_that_was_not_written(whole, number):
    path, data, table = whole
    at = table + 8 * number
    assert refusal(path, data[:at] + bytes(8) + data[at + 8 :]) == at


def test_every_end_before_the_end(whole):
    path, data, _ = whole
    for end in range(0, len(data), 7):
        assert refusal(path, data[:end]) <= end


def test_more_than_the_chunks(whole):
    path, data, _ = whole
    assert refusal(path, data + b"\0") == len(data)


def test_another_number_of_rows(whole):
    path, _, _ = whole
    for height in (HEIGHT + 16, HEIGHT - 16):
        with pytest.raises(StreamError):
            check_chunks(path, height, "b.exr")
