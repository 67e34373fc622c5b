"""The channels of a picture as they are made, band by band: in memory, or on disk."""

from __future__ import annotations

import mmap
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from bfrt.refusals import calling
from bfrt.streams.atomic_write import nameless
from bfrt.streams.writer import write_all

Channels = dict[str, npt.NDArray[Any]]


class ImageBuffer:
    """Collects a picture from its first row to its last.

    Parameters
    ----------
    width, height : int
        Pixels.
    scratch : Path, optional
        A folder, for a picture that memory has no room for: it is a file there that has no name,
        so that nothing is left of it when the picture is forgotten. By default it is in memory.
    """

    def __init__(self, width: int, height: int, scratch: Path | None = None) -> None:
        self._shape = (height, width)
        self._scratch = scratch
        self._path = (scratch or Path()) / "image"  # by which errors name what has no name
        self._row = 0
        self._channels: Channels = {}
        self._file: Any = None

    def add(self, band: Channels) -> None:
        """Add the next rows: an array (rows, width) of each channel."""
        if self._scratch is None:
            self._keep(band)
        else:
            self._write(band)
        self._row += len(next(iter(band.values())))

    def _keep(self, band: Channels) -> None:
        for name, rows in band.items():
            if name not in self._channels:
                self._channels[name] = np.empty(self._shape, rows.dtype)
            self._channels[name][self._row : self._row + len(rows)] = rows

    def _write(self, band: Channels) -> None:
        if self._file is None:
            self._file = nameless(self._path.parent, self._path)
            self._types = {name: rows.dtype for name, rows in band.items()}
        height, width = self._shape
        for number, rows in enumerate(band.values()):
            # Every channel has 4 bytes a pixel.
            at = (number * height + self._row) * width * 4
            with calling(self._path, "seeking", at):
                self._file.seek(at)
            write_all(self._file.fileno(), np.ascontiguousarray(rows), self._path, at)

    def channels(self) -> Channels:
        """Return the finished picture; arrays on disk are read on demand."""
        if self._file is None:
            return self._channels
        size = self._shape[0] * self._shape[1] * 4
        with calling(self._path, "mapping"):
            return {
                name: np.memmap(self._file, dtype, "r", number * size, self._shape)
                for number, (name, dtype) in enumerate(self._types.items())
            }


def expect(pixels: npt.NDArray[Any], rows: slice) -> None:
    """Have the system read rows of an array on disk at once, not page by page."""
    mapped = map_of(pixels)
    if mapped is not None:
        start = pixels[rows].ctypes.data - np.frombuffer(mapped, np.uint8).ctypes.data
        page = start // mmap.PAGESIZE * mmap.PAGESIZE
        mapped.madvise(mmap.MADV_WILLNEED, page, start - page + pixels[rows].nbytes)


def forget(pixels: npt.NDArray[Any]) -> None:
    """Release the memory of the parts read of an array on disk."""
    mapped = map_of(pixels)
    if mapped is not None:
        mapped.madvise(mmap.MADV_DONTNEED)


def map_of(pixels: npt.NDArray[Any]) -> mmap.mmap | None:
    """Return the map of a file that an array is in, or None."""
    base: Any = pixels
    while base is not None and not isinstance(base, mmap.mmap):
        base = getattr(base, "base", None)
    return base
