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
    """Collects pictures of one size, each from its first row to its last.

    They are held one below the other, whatever order their rows come in.

    Parameters
    ----------
    width, height : int
        Pixels of a picture.
    scratch : Path, optional
        A folder, for a picture that memory has no room for: it is a file there that has no name,
        so that nothing is left of it when the picture is forgotten. By default it is in memory.
    views : int
        Pictures.
    """

    def __init__(
        self, width: int, height: int, scratch: Path | None = None, views: int = 1
    ) -> None:
        self._height = height
        self._shape = (views * height, width)
        self._scratch = scratch
        self._path = (scratch or Path()) / "image"  # by which errors name what has no name
        self._rows = [0] * views
        self._channels: Channels = {}
        self._types: dict[str, np.dtype[Any]] = {}
        self._file: io.FileIO | None = None

    def add(self, band: Channels, view: int = 0) -> None:
        """Add the next rows of a picture: an array (rows, width) of each channel."""
        self._types = {name: rows.dtype for name, rows in band.items()}
        row = view * self._height + self._rows[view]
        for name, rows in band.items():
            self._put(name, row * self._shape[1], rows)
        self._rows[view] += len(next(iter(band.values())))

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
        return sum(self._rows) * self._shape[1] * 4 * len(self._types)

    def types(self) -> dict[str, np.dtype[Any]]:
        """Return the dtypes of the channels, once there are rows."""
        return self._types

    def complete(self, name: str) -> Iterator[npt.NDArray[Any]]:
        """Yield the pixels so far of a channel, picture by picture, some at a time."""
        for view, rows in enumerate(self._rows):
            at = view * self._height * self._shape[1]
            end = at + rows * self._shape[1]
            while at < end:
                some = min(end - at, LOOKED_AT_BYTES // 4)
                yield self._get(name, at, some)
                at += some

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

    def restore(
        self, types: dict[str, np.dtype[Any]], channels: dict[str, Pixels], rows: int
    ) -> None:
        """Begin with so many rows of each picture, whose pixels come as `complete` yields them."""
        self._types = types
        each, apart = rows * self._shape[1], self._height * self._shape[1]
        for name, blocks in channels.items():
            done = 0
            for pixels in blocks:
                at = 0
                while at < len(pixels):  # a block may end one picture and begin the next
                    view, inside = divmod(done, each)
                    some = pixels[at : at + each - inside]
                    self._put(name, view * apart + inside, some)
                    at, done = at + len(some), done + len(some)
        self._rows = [rows] * len(self._rows)

    @property
    def pixels(self) -> int:
        """Return the pixels of a row of all pictures."""
        return len(self._rows) * self._shape[1]

    def channels(self) -> Channels:
        """Return the finished pictures, one below the other; arrays on disk are read on demand.

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

    def each(self) -> list[Channels]:
        """Return the channels of each finished picture, parts of the arrays of `channels`."""
        whole, height = self.channels(), self._height
        return [
            {name: pixels[first : first + height] for name, pixels in whole.items()}
            for first in range(0, self._shape[0], height)
        ]

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
    """Add the rows that the film holds to the images, a few at a time."""
    rows = max(1, FILM_BAND // (film.shape[1] // film.views * 64))
    for view in range(film.views):
        for first in range(film.row, film.end, rows):
            buffer.add(film.rows(first, min(first + rows, film.end), view), view)


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
