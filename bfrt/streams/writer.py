"""Writing files of records: complete or an exception, counted and summed on the way.

A file's bytes are gathered in one of two buffers, while a thread sums and writes the other. What
has to be durable is synced on the way too, so that the disk works while there is more to make.
"""

from __future__ import annotations

import errno
import os
import zlib
from concurrent.futures import Future
from pathlib import Path
from types import TracebackType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bfrt.refusals import buffer_of, calling, give_up, refused
from bfrt.threads import Threads

Data = bytes | bytearray | memoryview | NDArray[Any]

#: Bytes of a buffer; a file has two, which take memory as they fill.
BUFFER_BYTES = 1 << 22

#: The least that is worth handing over by itself.
KEPT_BYTES = 1 << 18

#: Bytes of a durable file after which it is synced on the way.
SYNCED_BYTES = 1 << 25

#: How a new file is opened, and one that goes on, which is no link.
CREATE = os.O_WRONLY | os.O_CREAT | os.O_EXCL
GO_ON = os.O_WRONLY | getattr(os, "O_NOFOLLOW", 0)

#: Threads that write, and that sync, for all files.
WRITERS = Threads(2, "bfrt-write")
SYNCERS = Threads(2, "bfrt-sync")


def view_of(data: Data) -> memoryview:
    """Return the bytes of `data`, uncopied."""
    view = data.data if isinstance(data, np.ndarray) else memoryview(data)
    return view.cast("B") if view.nbytes else memoryview(b"")


def write_all(fd: int, data: Data, path: str | os.PathLike[str], offset: int) -> int:
    """Write all of `data` to `fd`, however many calls it takes; return the bytes.

    Raises
    ------
    DiskFullError, StreamError
        If the system refuses.
    """
    view = view_of(data)
    done = 0
    while done < len(view):
        try:
            done += os.write(fd, view[done:])
        except OSError as error:
            raise refused(path, offset + done, error, "writing") from error
    return done


class FileWriter:
    """Writes a new file, with its length and CRC-32; a `durable` one is fsynced at the end.

    What the system refuses is raised by a later `write`, or by `close`.

    Parameters
    ----------
    path : Path
    durable : bool
    behind : tuple of 2 int, optional
        Length and CRC-32 of what a file has already, behind which it goes on; what is behind that
        is cut off.
    buffer : int
        Bytes of a buffer, at the most.
    """

    def __init__(
        self, path: Path, durable: bool = True, behind: tuple[int, int] | None = None,
        buffer: int = BUFFER_BYTES,
    ) -> None:  # fmt: skip
        self.path = path
        self.bytes, self.checksum = behind or (0, 0)
        self._durable = durable
        self._written = self.bytes
        self._filled = 0
        self._unsynced = 0
        self._pending: Future[None] | None = None
        self._syncing: Future[None] | None = None
        self._size = min(buffer, BUFFER_BYTES)
        self._buffers = [buffer_of(self._size), buffer_of(self._size)]
        with calling(path, "creating" if behind is None else "opening"):
            self._fd = os.open(path, GO_ON if behind else CREATE, 0o666)
        if behind is not None:
            self._cut()

    def _cut(self) -> None:
        """Have the file end where it goes on."""
        try:
            with calling(self.path, "cutting", self.bytes):
                os.ftruncate(self._fd, self.bytes)
                os.lseek(self._fd, 0, os.SEEK_END)
        except BaseException:
            self.abandon()
            raise

    def write(self, data: Data, *, kept: bool = False) -> None:
        """Append `data` (C-contiguous); without a copy if the caller has `kept` it unchanged."""
        if self._fd < 0:
            raise refused(self.path, self.bytes, OSError(errno.EBADF, ""), "writing")
        view = view_of(data)
        self.bytes += len(view)
        if kept and len(view) >= KEPT_BYTES:
            self._flush()
            self._hand_over(view)
            return
        while len(view):
            n = min(len(view), self._size - self._filled)
            self._buffers[0][self._filled : self._filled + n] = view[:n]
            self._filled += n
            view = view[n:]
            if self._filled == self._size:
                self._flush()

    def _flush(self) -> None:
        """Have the buffer written, and go on with the other, when that is written."""
        if self._filled:
            self._hand_over(memoryview(self._buffers[0])[: self._filled])
            self._buffers.reverse()
            self._filled = 0

    def _hand_over(self, data: memoryview) -> None:
        self.wait()
        self._pending = WRITERS.submit(self._put, data)

    def _put(self, data: memoryview) -> None:
        self.checksum = zlib.crc32(data, self.checksum)
        self._written += write_all(self._fd, data, self.path, self._written)
        self._unsynced += len(data)
        if self._durable and self._unsynced >= SYNCED_BYTES:
            if self._syncing is not None:
                self._syncing.result()
            self._syncing = SYNCERS.submit(self._sync)
            self._unsynced = 0

    def _sync(self) -> None:
        with calling(self.path, "syncing", self._written):
            os.fsync(self._fd)

    def sync(self) -> None:
        """Have all that was written so far on the disk, and go on; a closed file is there."""
        if self._fd < 0:
            return
        self._flush()
        self.wait()
        self._sync()

    def wait(self) -> None:
        """Wait until what was handed over is written, so that its memory is free."""
        pending, self._pending = self._pending, None
        if pending is not None:
            pending.result()

    def close(self) -> None:
        """Complete it, and make it durable where that is wanted."""
        if self._fd < 0:
            return
        try:
            self._flush()
            self.wait()
            if self._syncing is not None:
                self._syncing.result()
            if self._durable:
                self._sync()
            fd, self._fd = self._fd, -1  # which is closed, whatever the system says
            with calling(self.path, "closing", self.bytes):
                os.close(fd)
        finally:
            self.abandon()

    def abandon(self) -> None:
        """Close an unfinished file, once no thread writes to it."""
        for busy in (self._pending, self._syncing):
            if busy is not None:
                busy.exception()
        self._pending = self._syncing = None
        fd, self._fd = self._fd, -1
        if fd >= 0:
            give_up(fd)

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
