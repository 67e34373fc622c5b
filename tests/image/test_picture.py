"""The picture in memory, and how saving fails."""

from __future__ import annotations

import errno

import numpy as np
import pytest

import bfrt
from bfrt.errors import DiskFullError, SettingError, StreamError
from bfrt.image import picture
from bfrt.image.picture import SUFFIXES, Image
from bfrt.records import NO_HIT


def test_views(make_image):
    image = make_image(4, 6)
    assert (image.height, image.width, image.shape) == (4, 6, (4, 6))
    assert image.rgb.shape == (4, 6, 3) and image.rgb.dtype == np.float32
    np.testing.assert_array_equal(image.rgb[..., 2], image.channels["B"])
    np.testing.assert_array_equal(image.rgba[..., 3], image.channels["A"])
    assert image.ids.dtype == np.uint64
    assert int(image.ids[-1, -1]) == NO_HIT
    low, high = image.channels["id.lo"][0, 0], image.channels["id.hi"][0, 0]
    assert int(image.ids[0, 0]) == int(high) << 32 | int(low)


def test_is_an_array(make_image):
    image = make_image(4, 6)
    np.testing.assert_array_equal(np.asarray(image), image.rgba)
    assert np.asarray(image, dtype=np.float64).dtype == np.float64
    with pytest.raises(ValueError, match="copy=False"):
        image.__array__(copy=False)


def test_repr(make_image):
    said = repr(make_image(4, 6))
    assert said == "<bfrt.Image 6 x 4, R G B A Z N.X N.Y N.Z id.lo id.hi, scene='rings 3'>"


def color(shape=(2, 3), dtype=np.float32):
    return {name: np.zeros(shape, dtype) for name in "RGBA"}


@pytest.mark.parametrize(
    ("channels", "message"),
    [
        ({}, "channels none, expected also R G B A"),
        ({"R": np.zeros((2, 3), np.float32)}, "expected also G B A"),
        (color(dtype=np.float64), "R: found float64"),
        (color((2, 3, 1)), r"R: found shape \(2, 3, 1\)"),
        (color((0, 3)), r"R: found shape \(0, 3\)"),
        (color() | {"Z": np.zeros((3, 2), np.float32)}, r"Z: found float32 of shape \(3, 2\)"),
        (color() | {"id.lo": np.zeros((2, 3), np.uint32)}, "expected both"),
        (
            color() | {"id.lo": np.zeros((2, 3), np.int32), "id.hi": np.zeros((2, 3), np.uint32)},
            "id.lo: found int32",
        ),
    ],
)
def test_channels_that_are_no_picture_are_refused(channels, message):
    with pytest.raises(SettingError, match=message):
        Image(channels)


def test_a_masked_channel_is_refused():
    with pytest.raises(SettingError, match="image: B: found masked elements, expected a value"):
        Image(color() | {"B": np.ma.masked_equal(np.eye(2, 3, dtype=np.float32), 1)})


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_no_picture_is_put_into_a_store(make_image, tmp_path, suffix):
    store = bfrt.spd.tetra(1).write(tmp_path / "s.bfrt").path
    (tmp_path / "link").symlink_to(store)
    before = sorted(tmp_path.rglob("*"))
    for folder in (store, store / "0", tmp_path / "link"):
        with pytest.raises(SettingError, match="found it to be in the store"):
            make_image(2, 2).save(folder / f"a{suffix}")
    with pytest.raises(SettingError, match="expected a path without NUL"):
        make_image(2, 2).save(f"{tmp_path}/a\0b{suffix}")
    assert sorted(tmp_path.rglob("*")) == before
    (tmp_path / "scene.json").write_text("{}")  # of something else
    make_image(2, 2).save(tmp_path / f"a{suffix}")


def test_ids_that_were_not_asked_for():
    with pytest.raises(SettingError, match=r"expected id\.lo and id\.hi"):
        _ = Image(color()).ids


def test_npy(make_image, tmp_path):
    image = make_image(7, 513)
    image.save(tmp_path / "a.npy")
    np.testing.assert_array_equal(np.load(tmp_path / "a.npy"), image.rgba)


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_saving_by_many_bands_changes_nothing(make_image, tmp_path, monkeypatch, suffix):
    image = make_image(40, 30)
    image.save(tmp_path / f"a{suffix}")
    monkeypatch.setattr(picture, "BAND_BYTES", 30 * 4 * 10 * 3)
    assert len(list(image.bands())) == 14
    image.save(tmp_path / f"b{suffix.upper()}")
    same = (tmp_path / f"a{suffix}").read_bytes() == (tmp_path / f"b{suffix.upper()}").read_bytes()
    assert same


@pytest.mark.parametrize("name", ["a.jpg", "a", ".exr"])
def test_other_suffixes_are_refused(make_image, tmp_path, name):
    with pytest.raises(SettingError, match=r"expected one of \.exr, \.png, \.npy"):
        make_image(2, 2).save(tmp_path / name)


@pytest.mark.parametrize("name", ["a.png", "a.npy"])
def test_half_is_only_for_exr(make_image, tmp_path, name):
    with pytest.raises(SettingError, match=r"only for \.exr"):
        make_image(2, 2).save(tmp_path / name, half=True)


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_full_disk(make_image, tmp_path, full_disk, suffix):
    target = tmp_path / f"a{suffix}"
    target.write_bytes(b"old")
    with pytest.raises(DiskFullError, match=f"a{suffix}: writing at byte 0") as caught:
        make_image(100, 100).save(target)
    assert caught.value.errno == errno.ENOSPC
    assert target.read_bytes() == b"old"
    assert list(tmp_path.iterdir()) == [target]


@pytest.mark.parametrize("part", [0.0, 0.5, 1.0])
@pytest.mark.parametrize("suffix", SUFFIXES)
def test_write_refused_anywhere(make_image, tmp_path, suffix, part):
    resource = pytest.importorskip("resource", reason="no limits of file size here")
    image = make_image(100, 100)
    whole = tmp_path / f"whole{suffix}"
    image.save(whole)
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (int(part * (whole.stat().st_size - 1)), hard))
    try:
        with pytest.raises(StreamError) as caught:
            image.save(tmp_path / f"a{suffix}")
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
    assert caught.value.errno == errno.EFBIG
    assert not isinstance(caught.value, DiskFullError)
    assert list(tmp_path.iterdir()) == [whole]
