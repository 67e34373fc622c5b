"""Writing files of records: complete or an exception, counted and summed on the way."""

from __future__ import annotations

import os
import zlib
from pathlib import Path
from types import TracebackType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bfrt.streams.aside import refused

Data = bytes | bytearray | memoryview | NDArray[Any]

#: What is gathered from small writes before the system is asked.
GATHER_BYTES = 1 << 18


def view_of(data: Data) -> memoryview:
    """The memory of `data`, uncopied."""
    return data.data if isinstance(data, np.ndarray) else memoryview(data)


def write_all(fd: int, data: Data, path: str | os.PathLike[str], offset: int) -> int:
    """Write all of `data` to `fd`, however many calls it takes; returns the bytes.

    Raises
    ------
    DiskFullError, StreamError
        If the system refuses.
    """
    view = view_of(data).cast("B")
    done = 0
    while done < len(view):
        try:
            done += os.write(fd, view[done:])
        except OSError as error:
            raise refused(path, offset + done, error, "writing") from error
    return done


class FileWriter:
    """A new file, with its length and CRC-32 as it grows; `durable` ones are fsynced at the end."""

    def __init__(self, path: Path, durable: bool = True) -> None:
        self.path = path
        self._durable = durable
        self.bytes = 0
        self.checksum = 0
        self._gathered = bytearray()
        try:
            self._fd = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o666)
        except OSError as error:
            raise refused(path, 0, error, "creating") from error

    def write(self, data: Data) -> None:
        """Append `data` (C-contiguous)."""
        view = view_of(data)
        if view.nbytes < GATHER_BYTES:
            self._gathered += view
            if len(self._gathered) >= GATHER_BYTES:
                self._flush()
        else:
            self._flush()
            self._put(view)

    def _flush(self) -> None:
        self._put(self._gathered)
        self._gathered = bytearray()

    def _put(self, data: Data) -> None:
        view = view_of(data)
        if view.nbytes:
            self.bytes += write_all(self._fd, view, self.path, self.bytes)
            self.checksum = zlib.crc32(view, self.checksum)

    def close(self) -> None:
        """Complete it, and make it durable where that is wanted."""
        try:
            self._flush()
            if self._durable:
                os.fsync(self._fd)
        except OSError as error:
            raise refused(self.path, self.bytes, error, "syncing") from error
        finally:
            self.abandon()

    def abandon(self) -> None:
        """Close without a promise."""
        fd, self._fd = self._fd, -1
        if fd >= 0:
            os.close(fd)

    def __enter__(self) -> FileWriter:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        if kind is None:
            self.close()
        else:
            self.abandon()
