"""EXR files hold every channel bit for bit."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import OpenEXR
import pytest

from bfrt.errors import SettingError, StreamError
from bfrt.image.exr import HALF_CHANNELS, write_exr

HEADER = {
    "bfrt.scene",
    "channels",
    "compression",
    "dataWindow",
    "displayWindow",
    "lineOrder",
    "pixelAspectRatio",
    "screenWindowCenter",
    "screenWindowWidth",
    "type",
}


def read(path):
    with OpenEXR.File(str(path), separate_channels=True) as file:
        return dict(file.header()), {name: c.pixels.copy() for name, c in file.channels().items()}


def bits(pixels):
    return pixels.view(np.uint16 if pixels.dtype == np.float16 else np.uint32)


def bands(channels, step):
    height = len(next(iter(channels.values())))
    for row in range(0, height, step):
        yield {name: pixels[row : row + step] for name, pixels in channels.items()}


@pytest.mark.parametrize("half", [False, True])
@pytest.mark.parametrize("shape", [(1, 1), (7, 513), (513, 7), (100, 64)])
def test_every_channel_comes_back(make_image, tmp_path, shape, half):
    image = make_image(*shape)
    image.save(tmp_path / "a.exr", half=half)
    header, channels = read(tmp_path / "a.exr")
    assert set(channels) == set(image.channels)
    for name, pixels in image.channels.items():
        expected = pixels
        if half and name in HALF_CHANNELS:
            expected = np.clip(pixels, -65504, 65504).astype(np.float16)
        assert channels[name].dtype == expected.dtype
        np.testing.assert_array_equal(bits(channels[name]), bits(expected), err_msg=name)
    assert header["bfrt.scene"] == "rings 3"
    assert header["compression"] == OpenEXR.ZIP_COMPRESSION


def test_half_is_clamped_and_keeps_nan(make_image, tmp_path):
    image = make_image(4, 10)
    image.save(tmp_path / "a.exr", half=True)
    _, channels = read(tmp_path / "a.exr")
    red = channels["R"][0]
    assert np.isnan(red[0])
    np.testing.assert_array_equal(red[1:3], [65504, -65504])
    np.testing.assert_array_equal(red[6:], [65504] * 4)
    assert not np.isinf(red).any()


def test_header_holds_nothing_else(make_image, tmp_path):
    make_image(3, 5).save(tmp_path / "a.exr")
    assert set(read(tmp_path / "a.exr")[0]) == HEADER


def test_same_bytes_for_the_same_picture_however_it_is_cut(make_image, tmp_path):
    image = make_image(50, 33)
    image.save(tmp_path / "a.exr")
    expected = (tmp_path / "a.exr").read_bytes()
    for step in (1, 7, 16, 50):
        path = tmp_path / f"{step}.exr"
        write_exr(path, 33, 50, bands(image.channels, step), image.metadata)
        assert path.read_bytes() == expected


def test_metadata_is_unicode_and_may_be_empty(make_image, tmp_path):
    make_image(2, 2, {"scene": "Würfel ✓", "none": "", "k" * 200: "v"}).save(tmp_path / "a.exr")
    header, _ = read(tmp_path / "a.exr")
    assert header["bfrt.scene"] == "Würfel ✓"
    assert header["bfrt.none"] == ""
    assert header["bfrt." + "k" * 200] == "v"


@pytest.mark.parametrize(
    "metadata", [{"": "x"}, {"k" * 251: "x"}, {"a\0": "x"}, {"a": "x\0y"}, {"a": "\udc80"}]
)
def test_metadata_that_cannot_be_kept_is_refused(make_image, tmp_path, metadata):
    with pytest.raises(SettingError, match="metadata"):
        make_image(2, 2, metadata).save(tmp_path / "a.exr")
    assert list(tmp_path.iterdir()) == []


def zeros(rows, width, **others):
    return {"R": np.zeros((rows, width), np.float32), **others}


@pytest.mark.parametrize(
    "rows",
    [
        [],
        [zeros(3, 5)],
        [zeros(5, 5)],
        [zeros(3, 5), zeros(2, 5)],
        [zeros(4, 4)],
        [zeros(0, 5), zeros(4, 5)],
        [{}],
        [{"R": np.zeros((4, 5))}],
        [zeros(4, 5, G=np.zeros((3, 5), np.float32))],
        [zeros(2, 5), zeros(2, 5, G=np.zeros((2, 5), np.float32))],
    ],
)
def test_rows_that_are_no_such_picture_are_refused(tmp_path, rows):
    with pytest.raises(SettingError, match=r"a\.exr: found .* expected"):
        write_exr(tmp_path / "a.exr", 5, 4, rows, {})
    assert list(tmp_path.iterdir()) == []


def test_rows_that_raise_leave_nothing(tmp_path):
    def rows():
        yield zeros(2, 5)
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        write_exr(tmp_path / "a.exr", 5, 4, rows(), {})
    assert list(tmp_path.iterdir()) == []


def test_end_that_found_no_room_is_noticed(make_image, tmp_path, monkeypatch):
    class Lossy:
        def __init__(self, path, header):
            self.path = path
            self.file = open_file(path, header)
            self.writePixels = self.file.writePixels

        def close(self):
            self.file.close()
            path = Path(os.fsdecode(self.path))
            os.truncate(path, path.stat().st_size - 1)

    open_file = OpenEXR.OutputFile
    monkeypatch.setattr(OpenEXR, "OutputFile", Lossy)
    with pytest.raises(StreamError, match=r"a\.exr"):
        make_image(40, 40).save(tmp_path / "a.exr")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.skipif(os.name == "nt", reason="names are Unicode here")
def test_name_that_is_no_unicode(make_image, tmp_path):
    path = tmp_path / os.fsdecode(b"\xff.exr")
    try:
        path.touch()
    except OSError:
        pytest.skip("the file system takes Unicode only")
    make_image(3, 3).save(path)
    assert OpenEXR.InputFile(os.fsencode(path)).isComplete()
