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
from bfrt.streams.atomic_write import nameless, refused
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
            file = self._opened(self._scratch)
            at = self._begin_of(name) + 4 * first
            file.seek(at)
            path = self._scratch / "image"
            write_all(file.fileno(), np.ascontiguousarray(pixels), path, at)
            return
        if name not in self._channels:
            self._channels[name] = np.empty(self._shape, pixels.dtype)
        self._channels[name].reshape(-1)[first : first + pixels.size] = pixels.reshape(-1)

    def _opened(self, scratch: Path) -> io.FileIO:
        if self._file is None:
            self._file = nameless(scratch, scratch / "image")
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
        path = self._scratch / "image"
        try:
            while len(view):
                got = os.preadv(self._opened(self._scratch).fileno(), [view], at)
                if not got:
                    raise ShortReadError(path, at, len(view), 0)
                view, at = view[got:], at + got
        except OSError as error:
            raise refused(path, at, error, "reading") from error
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
        """Return the finished picture; arrays on disk are read on demand."""
        if self._file is None:
            return self._channels
        height, width = self._shape
        return {
            name: np.memmap(
                self._file, dtype, mode="r", offset=number * height * width * 4, shape=self._shape
            )
            for number, (name, dtype) in enumerate(self._types.items())
        }


def resolve(film: Film, buffer: ImageBuffer) -> None:
    """Add the rows that the film holds to the image, a few at a time."""
    rows = max(1, FILM_BAND // (film.shape[1] * 64))
    for first in range(film.row, film.end, rows):
        buffer.add(film.rows(first, min(first + rows, film.end)))


def forget(pixels: npt.NDArray[Any]) -> None:
    """Release the memory of the parts read of an array on disk."""
    base: Any = pixels
    while base is not None and not isinstance(base, mmap.mmap):
        base = getattr(base, "base", None)
    if base is not None:
        base.madvise(mmap.MADV_DONTNEED)
