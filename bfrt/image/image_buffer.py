"""The channels of a picture as they are made, band by band: in memory, or on disk."""

from __future__ import annotations

import io
import mmap
import os
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from bfrt.errors import ShortReadError
from bfrt.image.film import Film
from bfrt.refusals import calling, give_up
from bfrt.streams.atomic_write import nameless
from bfrt.streams.spool import LOOKED_AT_BYTES
from bfrt.streams.writer import write_all

Channels = dict[str, npt.NDArray[Any]]
Pixels = Iterator[npt.NDArray[Any]]

#: Bytes of film that are averaged at once.
FILM_BAND = 1 << 20


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
        self._types: dict[str, np.dtype[Any]] = {}
        self._file: io.FileIO | None = None

    def add(self, band: Channels) -> None:
        """Add the next rows: an array (rows, width) of each channel."""
        self._types = {name: rows.dtype for name, rows in band.items()}
        for name, rows in band.items():
            self._put(name, self._row * self._shape[1], rows)
        self._row += len(next(iter(band.values())))

    def _put(self, name: str, first: int, pixels: npt.NDArray[Any]) -> None:
        """Put pixels of a channel, from number `first` on, to where they are held."""
        if self._scratch is not None:
            file = self._opened()
            at = self._begin_of(name) + 4 * first
            with calling(self._path, "seeking", at):
                file.seek(at)
            write_all(file.fileno(), np.ascontiguousarray(pixels), self._path, at)
            return
        if name not in self._channels:
            self._channels[name] = np.empty(self._shape, pixels.dtype)
        self._channels[name].reshape(-1)[first : first + pixels.size] = pixels.reshape(-1)

    def _opened(self) -> io.FileIO:
        if self._file is None:
            self._file = nameless(self._path.parent, self._path)
        return self._file

    def _begin_of(self, name: str) -> int:
        """Return where a channel begins in the file: every channel has 4 bytes a pixel."""
        return list(self._types).index(name) * self._shape[0] * self._shape[1] * 4

    @property
    def bytes(self) -> int:
        """Return the bytes of the rows so far: those that are complete."""
        return self._row * self._shape[1] * 4 * len(self._types)

    def types(self) -> dict[str, np.dtype[Any]]:
        """Return the dtypes of the channels, once there are rows."""
        return self._types

    def complete(self, name: str) -> Iterator[npt.NDArray[Any]]:
        """Yield the pixels so far of a channel, row by row, some at a time."""
        left, done = self._row * self._shape[1], 0
        while done < left:
            some = min(left - done, LOOKED_AT_BYTES // 4)
            yield self._get(name, done, some)
            done += some

    def _get(self, name: str, first: int, count: int) -> npt.NDArray[Any]:
        if self._scratch is None:
            return self._channels[name].reshape(-1)[first : first + count]
        pixels = np.empty(count, self._types[name])
        view, at = pixels.view(np.uint8).data, self._begin_of(name) + 4 * first
        while len(view):
            with calling(self._path, "reading", at):
                got = os.preadv(self._opened().fileno(), [view], at)
            if not got:
                raise ShortReadError(self._path, at, len(view), 0)
            view, at = view[got:], at + got
        return pixels

    def restore(self, types: dict[str, np.dtype[Any]], channels: dict[str, Pixels]) -> None:
        """Begin with the rows that channels have, whose pixels come some at a time."""
        self._types = types
        done = 0
        for name, blocks in channels.items():
            done = 0
            for pixels in blocks:
                self._put(name, done, pixels)
                done += len(pixels)
        self._row = done // self._shape[1]

    def channels(self) -> Channels:
        """Return the finished picture; arrays on disk are read on demand.

        Afterwards those alone hold what is on disk.
        """
        if self._file is None:
            return self._channels
        size = self._shape[0] * self._shape[1] * 4
        try:
            with calling(self._path, "mapping"):
                return {
                    name: np.memmap(self._file, dtype, "r", number * size, self._shape)
                    for number, (name, dtype) in enumerate(self._types.items())
                }
        finally:
            self.close()

    def close(self) -> None:
        """Free the disk, unless arrays hold it."""
        if self._file is not None:
            give_up(self._file)
            self._file = None


def expect(pixels: npt.NDArray[Any], rows: slice) -> None:
    """Have the system read rows of an array on disk at once, not page by page."""
    mapped = map_of(pixels)
    if mapped is not None:
        start = pixels[rows].ctypes.data - np.frombuffer(mapped, np.uint8).ctypes.data
        page = start // mmap.PAGESIZE * mmap.PAGESIZE
        mapped.madvise(mmap.MADV_WILLNEED, page, start - page + pixels[rows].nbytes)


def resolve(film: Film, buffer: ImageBuffer) -> None:
    """Add the rows that the film holds to the image, a few at a time."""
    rows = max(1, FILM_BAND // (film.shape[1] * 64))
    for first in range(film.row, film.end, rows):
        buffer.add(film.rows(first, min(first + rows, film.end)))


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
