"""OpenEXR files, written by rows.

Every channel is written as it is: float32 as FLOAT, uint32 as UINT. With `half`, color and alpha
(R G B A) become HALF, clamped to what a half can hold. ZIP compression, 16 scanlines a block, so
that the bytes do not depend on how many rows come at once. Nothing in the header knows the time.
"""

from __future__ import annotations

import contextlib
import errno
import itertools
import os
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import Imath
import numpy as np
import numpy.typing as npt
import OpenEXR

from bfrt.errors import SettingError, StreamError
from bfrt.image.exr_table import check_chunks
from bfrt.refusals import DISK_FULL, refused
from bfrt.streams.atomic_write import atomic_path

Band = Mapping[str, npt.NDArray[Any]]

HALF_CHANNELS = frozenset("RGBA")
HALF_MAX = 65504.0
NAME_BYTES = 255
PIXEL_TYPES = {
    np.dtype(np.float16): Imath.PixelType.HALF,
    np.dtype(np.float32): Imath.PixelType.FLOAT,
    np.dtype(np.uint32): Imath.PixelType.UINT,
}


def write_exr(
    path: str | os.PathLike[str],
    width: int,
    height: int,
    rows: Iterable[Band],
    metadata: Mapping[str, str],
    *,
    half: bool = False,
) -> None:
    """Write a picture that comes in bands of rows, from the top down.

    Parameters
    ----------
    path : path
        The file to make or replace; it appears only once it is complete.
    width, height : int
        The picture's size in pixels.
    rows : iterable of dict of str to ndarray, shape (n, width)
        Bands of any number of rows, `height` in all, with the same channels in each: float32 or
        uint32.
    metadata : dict of str to str
        Becomes string attributes, each with ``bfrt.`` before its name: so none can take the place
        of an attribute that OpenEXR needs.
    half : bool
        Store R G B A in 16 bits, clamped to +-65504.

    Raises
    ------
    SettingError
        If a band has not the shape or the channels that it must have, or a text cannot be kept.
    StreamError
        If the system refuses a write; `DiskFullError` where it has no room.
    """
    attributes = _attributes(metadata, path)
    bands = iter(rows)
    with atomic_path(path) as temporary:
        first = next(bands, None)
        if first is None:
            raise SettingError(f"{path}: found no rows, expected {height}")
        _check_band(first, width, path)
        types = {name: _stored_type(name, first[name], half) for name in sorted(first)}
        header = _header(width, height, types, attributes)
        with contextlib.closing(_open(temporary, header, path)) as file:
            row = 0
            for band in itertools.chain([first], bands):
                count = _check_band(band, width, path)
                if sorted(band) != list(types) or row + count > height:
                    raise SettingError(
                        f"{path}: found rows {row} to {row + count} of {' '.join(sorted(band))}, "
                        f"expected {height} rows of {' '.join(types)}"
                    )
                stored = {name: _stored(band[name], kind) for name, kind in types.items()}
                _write(file, stored, count, temporary, path)
                row += count
        if row != height:
            raise SettingError(f"{path}: found {row} rows, expected {height}")
        check_chunks(temporary, height, path)
        _check_end(temporary, next(iter(types)), height, path)


def _attributes(metadata: Mapping[str, str], path: str | os.PathLike[str]) -> dict[str, bytes]:
    """Return the metadata as OpenEXR takes it: C strings of UTF-8."""
    found = {}
    for key, text in metadata.items():
        name = f"bfrt.{key}"
        # A lone surrogate has no UTF-8, and a NUL would silently end the text.
        size = len(name.encode("utf-8", "replace"))
        encodable = (name + text).encode("utf-8", "replace").decode("utf-8") == name + text
        if not key or size > NAME_BYTES or "\0" in name + text or not encodable:
            raise SettingError(
                f"{path}: metadata {key!r}: found {text[:40]!r}, expected Unicode text without "
                f"NUL under a name of 1 to {NAME_BYTES - len('bfrt.')} bytes"
            )
        found[name] = text.encode("utf-8")
    return found


def _header(
    width: int,
    height: int,
    types: Mapping[str, np.dtype[Any]],
    attributes: Mapping[str, bytes],
) -> dict[str, Any]:
    header: dict[str, Any] = OpenEXR.Header(width, height)
    header["compression"] = Imath.Compression(Imath.Compression.ZIP_COMPRESSION)
    header["channels"] = {
        name: Imath.Channel(Imath.PixelType(PIXEL_TYPES[kind])) for name, kind in types.items()
    }
    return {**header, **attributes}


def _check_band(band: Band, width: int, path: str | os.PathLike[str]) -> int:
    """Return the number of rows of a band whose channels agree."""
    shapes = {pixels.shape for pixels in band.values()}
    types = {pixels.dtype for pixels in band.values()}
    shape = next(iter(shapes), ())
    if len(shapes) != 1 or len(shape) != 2 or shape[1] != width or shape[0] == 0:
        raise SettingError(
            f"{path}: found channels of shape {sorted(shapes)}, "
            f"expected one shape (n, {width}), n > 0"
        )
    if not types <= {np.dtype(np.float32), np.dtype(np.uint32)}:
        raise SettingError(
            f"{path}: found channels of {sorted(map(str, types))}, expected float32 or uint32"
        )
    return int(shape[0])


def _stored_type(name: str, pixels: npt.NDArray[Any], half: bool) -> np.dtype[Any]:
    return np.dtype(np.float16) if half and name in HALF_CHANNELS else pixels.dtype


def _stored(pixels: npt.NDArray[Any], kind: np.dtype[Any]) -> npt.NDArray[Any]:
    if kind == np.float16:
        pixels = np.clip(pixels, -HALF_MAX, HALF_MAX)
    return np.ascontiguousarray(pixels, dtype=kind)


def _open(temporary: Path, header: dict[str, Any], path: str | os.PathLike[str]) -> Any:
    try:
        # Bytes, because a name that is no UTF-8 could not be passed as str.
        return OpenEXR.OutputFile(os.fsencode(temporary), header)
    except OSError as error:
        raise _translated(error, temporary, path) from error


def _write(
    file: Any, stored: Band, count: int, temporary: Path, path: str | os.PathLike[str]
) -> None:
    try:
        file.writePixels(stored, count)
    except OSError as error:
        raise _translated(error, temporary, path) from error


def _check_end(temporary: Path, channel: str, height: int, path: str | os.PathLike[str]) -> None:
    """Read the last row back, which was written last."""
    try:
        file = OpenEXR.InputFile(os.fsencode(temporary))
        try:
            file.channel(channel, scanLine1=height - 1, scanLine2=height - 1)
        finally:
            file.close()
    except OSError as error:
        raise _translated(error, temporary, path) from error


def _translated(error: OSError, temporary: Path, path: str | os.PathLike[str]) -> StreamError:
    """Return OpenEXR's error as ours: it has no number, only the system's words inside its own."""
    number = next(
        (n for n in (*DISK_FULL, *errno.errorcode) if os.strerror(n) in str(error)), errno.EIO
    )
    written = 0
    with contextlib.suppress(OSError):  # it is the place of an error, not another
        written = temporary.stat().st_size
    return refused(path, written, OSError(number, str(error)), "writing")
