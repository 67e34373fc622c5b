"""Queues of records: in memory as long as they fit, then on disk, written and read in order."""

from __future__ import annotations

import os
import tempfile
import threading
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bfrt.errors import ShortReadError
from bfrt.streams.aside import refused
from bfrt.streams.writer import write_all

Records = NDArray[Any]


class Spool:
    """A first-in first-out queue of records.

    Parameters
    ----------
    dtype : numpy.dtype
        The record.
    room : int
        Records held in memory; all beyond are on disk. The memory is taken at once.
    scratch : Path
        Folder of the disk part, a file without a name: nothing is left behind by a crash.

    Raises
    ------
    DiskFullError, StreamError
        From `append` and `read`, as the system refuses.
    """

    def __init__(self, dtype: np.dtype[Any], room: int, scratch: Path) -> None:
        self.dtype = dtype
        self._counts = [0, 0, 0]  # bytes read, bytes written, seeks
        self._memory = np.empty(room, dtype)
        self._scratch = scratch
        self._appending = threading.Lock()
        self._fd = -1
        self._last_end = 0
        self.clear()

    def clear(self) -> None:
        """Forget every record; the memory stays, the disk is given back."""
        self.close()
        self._appended = 0
        self._taken = 0

    def __len__(self) -> int:
        """Records that wait."""
        return self._appended - self._taken

    def append(self, records: Records) -> None:
        """Add a copy of `records` (n,). Threads may do it at once; order is then theirs."""
        with self._appending:
            inside = max(0, min(len(records), len(self._memory) - self._appended))
            self._memory[self._appended : self._appended + inside] = records[:inside]
            if inside < len(records):
                self._write(np.ascontiguousarray(records[inside:]))
            self._appended += len(records)

    def read(self, most: int) -> Records:
        """Up to `most` records, oldest first: a view of memory, or an array of its own."""
        first = self._taken
        inside = len(self._memory) - first
        n = min(most, len(self), inside if inside > 0 else most)
        self._taken += n
        if inside > 0:
            return self._memory[first : first + n]
        return self._read(first - len(self._memory), n)

    def counts(self) -> tuple[int, int, int]:
        """Bytes read, bytes written and seeks on disk since the last call."""
        read, written, seeks = self._counts
        self._counts = [0, 0, 0]
        return read, written, seeks

    def close(self) -> None:
        """Give the disk back."""
        fd, self._fd = self._fd, -1
        if fd >= 0:
            os.close(fd)

    def _write(self, records: Records) -> None:
        if self._fd < 0:
            self._fd = self._nameless()
        offset = max(0, self._appended - len(self._memory)) * self.dtype.itemsize
        os.lseek(self._fd, offset, os.SEEK_SET)
        self._last_end = offset + write_all(
            self._fd, records.view(np.uint8), self._scratch / "spool", offset
        )
        self._counts[1] += records.nbytes

    def _read(self, first: int, n: int) -> Records:
        records = np.empty(n, self.dtype)
        view = memoryview(records.view(np.uint8))
        offset = first * self.dtype.itemsize
        self._counts[2] += offset != self._last_end
        done = 0
        try:
            os.lseek(self._fd, offset, os.SEEK_SET)
            while done < len(view):
                got = os.readv(self._fd, [view[done:]])
                if got == 0:
                    raise ShortReadError(
                        self._scratch / "spool", offset + done, len(view) - done, 0
                    )
                done += got
        except OSError as error:
            raise refused(self._scratch / "spool", offset + done, error, "reading") from error
        self._last_end = offset + done
        self._counts[0] += done
        return records

    def _nameless(self) -> int:
        try:
            fd, name = tempfile.mkstemp(prefix="bfrt-", suffix=".spool", dir=self._scratch)
            Path(name).unlink()
        except OSError as error:
            raise refused(self._scratch / "spool", 0, error, "creating") from error
        return fd
