"""PNG files: the right codes, in a file that any decoder reads."""

from __future__ import annotations

import struct
import zlib

import numpy as np
import pytest

from bfrt.errors import SettingError
from bfrt.image.png import BORDERS, encode_png, encode_srgb, write_png


def chunks(data):
    assert data[:8] == b"\x89PNG\r\n\x1a\n"
    at = 8
    while at < len(data):
        size, name = struct.unpack_from(">I4s", data, at)
        body = data[at + 8 : at + 8 + size]
        assert struct.unpack_from(">I", data, at + 8 + size)[0] == zlib.crc32(name + body)
        yield name, body
        at += 12 + size


def decode(data):
    """The pixels of an 8-bit RGB PNG whose lines all have the filter Sub."""
    parts = list(chunks(data))
    assert parts[0][0] == b"IHDR" and parts[-1] == (b"IEND", b"")
    width, height, *rest = struct.unpack(">IIBBBBB", parts[0][1])
    assert rest == [8, 2, 0, 0, 0]
    raw = zlib.decompress(b"".join(body for name, body in parts if name == b"IDAT"))
    lines = np.frombuffer(raw, np.uint8).reshape(height, 1 + 3 * width)
    assert (lines[:, 0] == 1).all()
    return np.cumsum(lines[:, 1:].reshape(height, width, 3), axis=1, dtype=np.uint8)


def srgb(linear):
    """IEC 61966-2-1, then rounded half up."""
    x = np.clip(np.asarray(linear, np.float64), 0.0, 1.0)
    curve = np.where(x <= 0.0031308, 12.92 * x, 1.055 * x ** (1 / 2.4) - 0.055)
    return np.floor(255 * curve + 0.5).astype(np.uint8)


def test_codes_are_those_of_the_standard():
    random = np.random.default_rng(1)
    linear = np.concatenate(
        [random.random(200_000), random.random(200_000) * 0.01, np.linspace(-0.5, 1.5, 50_001)]
    ).astype(np.float32)
    np.testing.assert_array_equal(encode_srgb(linear), srgb(linear))


def test_known_codes():
    linear = [np.nan, -np.inf, -0.0, 0.0, 0.0031308, 0.2158605, 0.5, 1.0, 2.0, np.inf]
    assert encode_srgb(linear).tolist() == [0, 0, 0, 0, 10, 128, 188, 255, 255, 255]


def test_every_code_comes_back_from_its_own_light():
    codes = np.arange(256)
    x = codes / 255
    linear = np.where(x <= 0.04045, x / 12.92, ((x + 0.055) / 1.055) ** 2.4)
    np.testing.assert_array_equal(encode_srgb(linear), codes)


def test_rounds_half_up():
    assert encode_srgb(0.5 / 255 / 12.92) == 1
    assert encode_srgb(np.nextafter(0.5 / 255 / 12.92, 0)) == 0


def test_no_float32_is_within_a_libm_of_a_border():
    nearest = BORDERS.astype(np.float32).astype(np.float64)
    assert (np.abs(nearest - BORDERS) > 1e-13 * BORDERS).all()


@pytest.mark.parametrize("shape", [(1, 1), (7, 513), (513, 7), (300, 200)])
def test_file_decodes_to_the_codes(make_image, tmp_path, shape):
    image = make_image(*shape)
    image.save(tmp_path / "a.png")
    data = (tmp_path / "a.png").read_bytes()
    rgb = image.rgb
    np.testing.assert_array_equal(decode(data), srgb(np.where(np.isnan(rgb), 0, rgb)))
    assert (b"sRGB", b"\0") in chunks(data)
    assert image._repr_png_() == data


def test_same_bytes_however_it_is_cut(make_image):
    image = make_image(300, 200)
    expected = image._repr_png_()
    assert len(expected) > 2 * (1 << 16)  # so that there are several chunks of data
    for step in (1, 7, 299):
        bands = (
            {name: pixels[row : row + step] for name, pixels in image.channels.items()}
            for row in range(0, 300, step)
        )
        assert b"".join(encode_png(200, 300, bands)) == expected


def zeros(*shape):
    return dict.fromkeys("RGB", np.zeros(shape, np.float32))


@pytest.mark.parametrize(
    "rows",
    [[], [zeros(3, 5)], [zeros(5, 5)], [zeros(2, 5), zeros(3, 5)], [zeros(4, 4)], [zeros(4)]],
)
def test_rows_that_are_no_such_picture_are_refused(tmp_path, rows):
    with pytest.raises(SettingError, match=r"found .* expected"):
        write_png(tmp_path / "a.png", 5, 4, rows)
    assert list(tmp_path.iterdir()) == []
