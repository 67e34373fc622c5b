"""Pictures one after another in one file: animated PNG, and GIF.

An animated PNG (https://www.w3.org/TR/png-3/#apng-frame-based-animation) is a PNG whose further
frames are in chunks that others pass over: sRGB of 8 bits as of a single picture. A GIF has 256
colors a frame, which Pillow chooses. One frame is in memory at a time.
"""

from __future__ import annotations

import io
import os
import struct
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from bfrt.errors import SettingError
from bfrt.image.picture import Image
from bfrt.image.png import SIGNATURE, chunk, deflated, header, pieces, scanlines
from bfrt.paths import path_of
from bfrt.streams.atomic_write import write_parts

SUFFIXES = (".gif", ".png")

#: A frame covers those before it, and none is mixed in.
OVER = 0

#: Bytes of a GIF's parts, and what they begin with.
GIF_HEAD, GIF_PLACE = 13, 10
GIF_EXTENSION, GIF_IMAGE, GIF_END = 0x21, 0x2C, 0x3B


def check_animation(path: str | os.PathLike[str]) -> None:
    """Refuse a file that could not be an animation: by its suffix, or since Pillow is missing.

    Raises
    ------
    SettingError
        If it could not.
    """
    suffix = path_of("image", path).suffix.lower()
    if suffix not in SUFFIXES:
        raise SettingError(
            f"{os.fspath(path)}: found suffix {suffix!r} of an animation, expected "
            f"{' or '.join(SUFFIXES)}"
        )
    if suffix == ".gif":
        pillow(path)


def pillow(path: str | os.PathLike[str]) -> Any:
    """Return ``PIL.Image``.

    Raises
    ------
    SettingError
        If Pillow is not installed.
    """
    try:
        import PIL.Image
    except ImportError:
        raise SettingError(
            f"{os.fspath(path)}: a GIF needs Pillow: pip install bfrt[animation], or write .png"
        ) from None
    return PIL.Image


def write_animation(path: str | os.PathLike[str], images: Sequence[Image], seconds: float) -> None:
    """Write pictures of one size one after another, without end; `seconds` is each one's time.

    Raises
    ------
    SettingError
        As `check_animation`.
    StreamError
        If the system refuses a write; `DiskFullError` where it has no room.
    """
    check_animation(path)
    if Path(path).suffix.lower() == ".png":
        write_parts(path, encode_apng(images, round(1000 * seconds)))
    else:
        write_parts(path, encode_gif(images, round(100 * seconds), pillow(path)))


def encode_apng(images: Sequence[Image], milliseconds: int) -> Iterator[bytes]:
    """Yield the bytes of an animated PNG."""
    height, width = images[0].shape
    yield SIGNATURE
    yield from header(width, height)
    yield chunk(b"acTL", struct.pack(">II", len(images), 0))
    sequence = 0
    for number, image in enumerate(images):
        frame = (sequence, width, height, 0, 0, milliseconds, 1000, OVER, OVER)
        yield chunk(b"fcTL", struct.pack(">IIIIIHHBB", *frame))
        sequence += 1
        for data in pieces(deflated(scanlines(width, height, image.bands()))):
            if number == 0:
                yield chunk(b"IDAT", data)
            else:
                yield chunk(b"fdAT", struct.pack(">I", sequence) + data)
                sequence += 1
    yield chunk(b"IEND", b"")


def encode_gif(images: Iterable[Image], hundredths: int, maker: Any) -> Iterator[bytes]:
    """Yield the bytes of an animated GIF, of which each frame has its own colors.

    Parameters
    ----------
    maker : module
        ``PIL.Image``, which chooses the colors and packs a frame.
    """
    for number, image in enumerate(images):
        height, width = image.shape
        if number == 0:
            yield b"GIF89a" + struct.pack("<HHBBB", width, height, 0x70, 0, 0)
            yield b"\x21\xff\x0bNETSCAPE2.0\x03\x01" + struct.pack("<H", 0) + b"\0"
        frame = frame_of(packed_gif(image, maker))
        yield b"\x21\xf9\x04\x04" + struct.pack("<H", hundredths) + b"\0\0"
        depth = (len(frame.palette) // 3).bit_length() - 2
        yield struct.pack("<BHHHHB", GIF_IMAGE, 0, 0, width, height, 0x80 | depth)
        yield frame.palette + frame.data
    yield bytes([GIF_END])


def packed_gif(image: Image, maker: Any) -> bytes:
    """Return a picture as a GIF of its own.

    Raises
    ------
    MemoryError
        If there is none, of which Pillow says that it has not come to colors, or to a file.
    """
    packed = io.BytesIO()
    try:
        maker.fromarray(image.srgb()).quantize(256).save(packed, "GIF")
    except (ValueError, OSError) as error:
        raise MemoryError(f"the 256 colors of a frame (Pillow: {error})") from error
    return packed.getvalue()


class Frame(NamedTuple):
    """Holds a frame of a GIF: its colors, and its packed pixels."""

    palette: bytes
    data: bytes


def frame_of(gif: bytes) -> Frame:
    """Return the frame of a GIF that has one, and its colors in the head."""
    palette_end = GIF_HEAD + 3 * (2 << (gif[GIF_HEAD - 3] & 7))
    at = palette_end
    while gif[at] == GIF_EXTENSION:
        at += 2
        while gif[at]:
            at += gif[at] + 1
        at += 1
    return Frame(gif[GIF_HEAD:palette_end], gif[at + GIF_PLACE : gif.rindex(GIF_END)])
