"""Queues of records: in memory as long as they fit, then on disk, written and read in order."""

from __future__ import annotations

import io
import threading
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bfrt.errors import ShortReadError
from bfrt.records import plain
from bfrt.refusals import calling, give_up, refused
from bfrt.streams.atomic_write import nameless
from bfrt.streams.writer import write_all

Records = NDArray[Any]

#: Records that there is memory for from the beginning, or a few times as many.
FIRST = 1 << 14

#: Bytes that are read at once of records that go on waiting.
LOOKED_AT_BYTES = 1 << 20


class Spool:
    """Queues records, first in first out.

    Parameters
    ----------
    dtype : numpy.dtype
        The record.
    room : int
        Records held in memory; all beyond are on disk. The memory is taken as records come.
    scratch : Path
        Folder of the disk part, a file without a name: nothing is left behind by a crash.

    Raises
    ------
    DiskFullError, StreamError
        From `append` and `read`, as the system refuses.
    TypeError
        From `append`, for records of another dtype.
    """

    def __init__(self, dtype: np.dtype[Any], room: int, scratch: Path) -> None:
        self.dtype = dtype
        self._counts = [0, 0, 0]  # bytes read, bytes written, seeks
        self._room = room
        self._memory = np.empty(self._size_for(0), dtype)
        self._scratch = scratch
        self._path = scratch / "spool"  # by which errors name the file that has no name
        self._appending = threading.Lock()
        self._file: io.FileIO | None = None
        self._last_end = 0
        self.clear()

    def clear(self) -> None:
        """Forget every record; the memory stays, the disk is given back."""
        self.close()
        self._appended = 0
        self._taken = 0

    def beside(self) -> Spool:
        """Return an empty spool of the same records, all on disk, whose traffic this one counts."""
        other = Spool(self.dtype, 0, self._scratch)
        other._counts = self._counts
        return other

    def __len__(self) -> int:
        """Return the number of records that wait."""
        return self._appended - self._taken

    def append(self, records: Records) -> None:
        """Add a copy of `records` (n,). Threads may do it at once; order is then theirs."""
        if records.dtype != self.dtype:
            raise TypeError(f"spool: found records of {records.dtype}, expected {self.dtype}")
        with self._appending:
            inside = max(0, min(len(records), self._room - self._appended))
            if inside:
                self._make_room(self._appended + inside)
            memory = self._memory[self._appended : self._appended + inside]
            plain(memory)[:] = plain(records[:inside])
            if inside < len(records):
                self._write(np.ascontiguousarray(records[inside:]))
            self._appended += len(records)

    def read(self, most: int) -> Records:
        """Return up to `most` records, oldest first: a view of memory, or a new array."""
        first = self._taken
        inside = self._room - first
        n = min(most, len(self), inside if inside > 0 else most)
        self._taken += n
        if inside > 0 or n == 0:
            return self._memory[first : first + n]
        return self._read(first - self._room, n)

    def waiting(self) -> Iterator[Records]:
        """Yield the records that wait, oldest first, and leave them: views of memory, new arrays.

        None may be appended or read meanwhile; of their traffic nothing is counted.
        """
        first = self._taken
        if first < min(self._room, self._appended):
            yield self._memory[first : min(self._room, self._appended)]
        counts, last_end, first = [*self._counts], self._last_end, max(first, self._room)
        while first < self._appended:
            n = min(self._appended - first, max(1, LOOKED_AT_BYTES // self.dtype.itemsize))
            yield self._read(first - self._room, n)
            first += n
        self._counts[:], self._last_end = counts, last_end

    def restore(self, blocks: Iterable[Records]) -> None:
        """Hold these records alone, in order; of the traffic nothing is counted."""
        self.clear()
        for block in blocks:
            self.append(block)
        self.counts()

    def counts(self) -> tuple[int, int, int]:
        """Return the bytes read, bytes written and seeks on disk since the last call."""
        read, written, seeks = self._counts
        self._counts[:] = 0, 0, 0
        return read, written, seeks

    def close(self) -> None:
        """Give the disk back."""
        file, self._file = self._file, None
        if file is not None:
            give_up(file)

    def _size_for(self, records: int) -> int:
        """Return the size of a memory that holds so many: the room, or a fourth, or a fourth of it.

        So a copy of the memory to a larger one takes half of the room at the most.
        """
        size = self._room
        while size // 4 >= max(records, FIRST):
            size //= 4
        return size

    def _make_room(self, records: int) -> None:
        """Take more memory where so many records, no more than the room has, do not fit."""
        held = self._memory
        if records > len(held):
            self._memory = np.empty(self._size_for(records), self.dtype)
            plain(self._memory)[: self._appended] = plain(held[: self._appended])

    def _write(self, records: Records) -> None:
        if self._file is None:
            self._file = nameless(self._scratch, self._path)
        offset = max(0, self._appended - self._room) * self.dtype.itemsize
        with calling(self._path, "seeking", offset):
            self._file.seek(offset)
        self._last_end = offset + write_all(
            self._file.fileno(), records.view(np.uint8), self._path, offset
        )
        self._counts[1] += records.nbytes

    def _read(self, first: int, n: int) -> Records:
        if self._file is None:
            raise ValueError(f"{self._path}: read after close")
        records = np.empty(n, self.dtype)
        view = records.view(np.uint8).data
        offset = first * self.dtype.itemsize
        self._counts[2] += offset != self._last_end
        done = 0
        try:
            self._file.seek(offset)
            while done < len(view):
                got = self._file.readinto(view[done:])
                if not got:
                    raise ShortReadError(self._path, offset + done, len(view) - done, 0)
                done += got
        except OSError as error:
            raise refused(self._path, offset + done, error, "reading") from error
        self._last_end = offset + done
        self._counts[0] += done
        return records
