"""PNG files, written by rows: 8 bits of sRGB, clipped, without alpha.

The picture's background is part of it, so alpha is ignored. The format is small and this is all of
it that a picture needs: https://www.w3.org/TR/png/.
"""

from __future__ import annotations

import os
import struct
import zlib
from collections.abc import Iterable, Iterator, Mapping
from typing import Any

import numpy as np
import numpy.typing as npt

from bfrt.errors import SettingError
from bfrt.streams.atomic_write import write_parts

SIGNATURE = b"\x89PNG\r\n\x1a\n"
CHUNK_BYTES = 1 << 16
DEFLATE_LEVEL = 6

#: Pixels that are encoded at once, or a row.
PIECE_PIXELS = 1 << 14

FILTER_SUB = 1
PERCEPTUAL = 0


def _linear(encoded: float) -> float:
    """Return the light that an sRGB value in 0 to 1 stands for (IEC 61966-2-1)."""
    return encoded / 12.92 if encoded <= 0.04045 else float(((encoded + 0.055) / 1.055) ** 2.4)


#: A code k is what rounds to it, half up: the values from (k - 1/2) / 255 on. Looking a value up
#: among the 255 borders is exact, needs no power per pixel, and is the same on every processor: no
#: border comes as near to a float32 as two libms differ.
BORDERS = np.array([_linear((code - 0.5) / 255) for code in range(1, 256)])


def encode_srgb(linear: npt.ArrayLike) -> npt.NDArray[np.uint8]:
    """Return the 8-bit sRGB codes of linear values, clipped to 0 to 1; NaN becomes 0."""
    values = np.asarray(linear, dtype=np.float64)
    codes = np.searchsorted(BORDERS, np.where(np.isnan(values), 0.0, values), side="right")
    return codes.astype(np.uint8)


def write_png(
    path: str | os.PathLike[str],
    width: int,
    height: int,
    rows: Iterable[Mapping[str, npt.NDArray[Any]]],
) -> None:
    """Write a picture that comes in bands of rows, from the top down.

    Parameters
    ----------
    path : path
        The file to make or replace; it appears only once it is complete.
    width, height : int
        The picture's size in pixels.
    rows : iterable of dict of str to ndarray, shape (n, width)
        Bands of any number of rows, `height` in all. Of their channels R G B are taken: linear.

    Raises
    ------
    SettingError
        If the rows are not as many or not as wide as they must be.
    StreamError
        If the system refuses a write; `DiskFullError` where it has no room.
    """
    write_parts(path, encode_png(width, height, rows))


def encode_png(
    width: int, height: int, rows: Iterable[Mapping[str, npt.NDArray[Any]]]
) -> Iterator[bytes]:
    """Yield the bytes of a PNG file; they do not depend on how many rows come at once."""
    yield SIGNATURE
    yield from header(width, height)
    for data in pieces(deflated(scanlines(width, height, rows))):
        yield chunk(b"IDAT", data)
    yield chunk(b"IEND", b"")


def header(width: int, height: int) -> Iterator[bytes]:
    """Yield the chunks before the pixels."""
    # 8 bits, color type 2 (RGB), then deflate, the five standard filters, not interlaced.
    yield chunk(b"IHDR", struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0))
    yield chunk(b"sRGB", bytes([PERCEPTUAL]))


def pieces(parts: Iterable[bytes]) -> Iterator[bytes]:
    """Yield the same bytes, `CHUNK_BYTES` at a time."""
    waiting = bytearray()
    for part in parts:
        waiting += part
        while len(waiting) >= CHUNK_BYTES:
            yield bytes(waiting[:CHUNK_BYTES])
            del waiting[:CHUNK_BYTES]
    if waiting:
        yield bytes(waiting)


def chunk(name: bytes, data: bytes) -> bytes:
    """Return a chunk of a PNG file."""
    check = zlib.crc32(data, zlib.crc32(name))
    return struct.pack(">I", len(data)) + name + data + struct.pack(">I", check)


def deflated(lines: Iterable[bytes]) -> Iterator[bytes]:
    """Compress line by line, so that the bytes cannot depend on the bands."""
    compressor = zlib.compressobj(DEFLATE_LEVEL)
    for line in lines:
        yield compressor.compress(line)
    yield compressor.flush()


def _some_rows(
    width: int, rows: Iterable[Mapping[str, npt.NDArray[Any]]]
) -> Iterator[Mapping[str, npt.NDArray[Any]]]:
    """Yield the colors of bands, a few rows at a time: codes take ten times what they are of."""
    step = max(1, PIECE_PIXELS // max(1, width))
    for band in rows:
        for first in range(0, len(band["R"]), step):
            yield {name: band[name][first : first + step] for name in "RGB"}


def scanlines(
    width: int, height: int, rows: Iterable[Mapping[str, npt.NDArray[Any]]]
) -> Iterator[bytes]:
    """Yield filtered scanlines: each byte less the same color's one to the left."""
    row = 0
    for band in _some_rows(width, rows):
        pixels = encode_srgb(np.stack([band[name] for name in "RGB"], axis=-1))
        if pixels.ndim != 3 or pixels.shape[1] != width or row + len(pixels) > height:
            raise SettingError(
                f"PNG: found a band of shape {pixels.shape[:-1]} at row {row}, "
                f"expected rows of a picture of {height} x {width}"
            )
        lines = np.empty((len(pixels), 1 + 3 * width), dtype=np.uint8)
        lines[:, 0] = FILTER_SUB
        lines[:, 1:4] = pixels[:, 0]
        lines[:, 4:] = (pixels[:, 1:] - pixels[:, :-1]).reshape(len(pixels), -1)
        for line in lines:
            yield line.tobytes()
        row += len(pixels)
    if row != height:
        raise SettingError(f"PNG: found {row} rows, expected {height}")
