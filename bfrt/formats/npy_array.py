"""NumPy's format of an array, read forwards, a block of rows at a time.

An array is not mapped, so that a disk that fails is an error and not the end of the process.
"""

from __future__ import annotations

import contextlib
import copy
import math
import os
from collections.abc import Callable, Iterator
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from bfrt.errors import BfrtError, SceneError, ShortReadError
from bfrt.formats.source import printable, said
from bfrt.formats.table import frame_of

#: Bytes of a header: NumPy takes no more either.
HEADER_BYTES = 10_000

#: Columns of an array in Fortran order, each of which is read by a file of its own.
MOST_COLUMNS = 16


class Readable(Protocol):
    """Provides the bytes of an array, read forwards."""

    def read(self, size: int = ..., /) -> bytes: ...

    def readinto(self, buffer: Any, /) -> int: ...

    def seek(self, offset: int, whence: int = ..., /) -> int: ...

    def tell(self) -> int: ...

    def close(self) -> None: ...


class NpyArray:
    """Reads an array in NumPy's format.

    Parameters
    ----------
    name : str
        For errors.
    open_it : callable
        Opens its bytes from their begin.

    Raises
    ------
    SceneError
        If they are no array of numbers in rows.
    StreamError
        If the system refuses to read them.
    """

    def __init__(self, name: str, open_it: Callable[[], Readable]) -> None:
        self.name = name
        self._open = open_it
        self._skipped = 0  # bytes before the first row
        self._is_last = True  # so that the file ends behind its rows
        with contextlib.closing(open_it()) as file:
            self.shape, self.dtype, self._columns = self._header(file)

    def _header(self, file: Readable) -> tuple[tuple[int, ...], np.dtype[Any], int]:
        """Read the header: the shape, the dtype, and the columns of Fortran order, else 1."""
        with self._read("NumPy's header of an array"):
            version = np.lib.format.read_magic(file)
            read = np.lib.format.read_array_header_2_0
            if version == (1, 0):
                read = np.lib.format.read_array_header_1_0
            elif version not in ((2, 0), (3, 0)):
                raise ValueError(f"version {version}")
            try:
                shape, fortran, dtype = read(file, max_header_size=HEADER_BYTES)
            except MemoryError as error:  # what Python says of text that is nested too deeply
                raise ValueError(f"a header of {HEADER_BYTES} bytes or fewer, too deep") from error
            if version == (3, 0) and dtype.names:  # which is 2.0 with names of UTF-8
                dtype.names = tuple(name.encode("latin1").decode() for name in dtype.names)
        whole = all(isinstance(n, int) and not isinstance(n, bool) and n >= 0 for n in shape)
        plain = not dtype.hasobject and dtype.subdtype is None
        columns = max(1, math.prod(shape[1:])) if fortran and whole else 1
        if not shape or not whole or not plain or columns > MOST_COLUMNS:
            order = "Fortran" if fortran else "C"
            raise SceneError(
                f"{self.name}: found {printable(str(dtype))} of shape {shape} in {order} order, "
                f"expected numbers in rows, in Fortran order at most {MOST_COLUMNS} in each"
            )
        return shape, dtype, columns

    def blocks(self, rows: int) -> Iterator[NDArray[Any]]:
        """Yield all rows, `rows` at a time."""
        row = math.prod(self.shape[1:]) * self.dtype.itemsize
        left = self.shape[0] if row else 0
        with contextlib.ExitStack() as stack:
            closing = contextlib.closing
            files = [stack.enter_context(closing(self._open())) for _ in range(self._columns)]
            for column, file in enumerate(files):
                self._header(file)
                with self._read("an array's bytes"):
                    before = self._skipped + column * left * self.dtype.itemsize
                    file.seek(before, os.SEEK_CUR)
            while left:
                n = min(rows, left)
                parts = [self._exactly(file, n * row // len(files)) for file in files]
                yield self._joined([part.view(self.dtype) for part in parts], n)
                left -= n
            if row and self._is_last:
                self._end(files[-1])

    def shallow(self) -> NpyArray:
        """Return the rows of a map one after another: (h, w, 3) as (h w, 3)."""
        self._check_order()
        flat = copy.copy(self)
        flat.shape = (self.shape[0] * self.shape[1], *self.shape[2:])
        return flat

    def frame(self, number: int) -> NpyArray:
        """Return a frame of (frames, n, 3), as (n, 3)."""
        self._check_order()
        one = copy.copy(self)
        place = frame_of(number, self.shape[0], self.name)
        one._is_last = place + 1 == self.shape[0]
        one._skipped = place * math.prod(self.shape[1:]) * self.dtype.itemsize
        one.shape = self.shape[1:]
        return one

    def _check_order(self) -> None:
        """Refuse columns, of which there is a file each, where dimensions are taken apart."""
        if self._columns > 1:
            raise SceneError(
                f"{self.name}: found shape {self.shape} in Fortran order, expected C order for "
                "more than two dimensions"
            )

    def _joined(self, parts: list[NDArray[Any]], n: int) -> NDArray[Any]:
        shape = (n, *self.shape[1:])
        if len(parts) == 1:
            return parts[0].reshape(shape)
        return np.ascontiguousarray(np.stack(parts, axis=-1).reshape(shape, order="F"))

    def _end(self, file: Readable) -> None:
        with self._read("its end"):
            more = file.read(1)
        if more:
            raise SceneError(
                f"{self.name}: byte {file.tell() - 1}: found more bytes than an array of shape "
                f"{self.shape} has, expected its end"
            )

    def _exactly(self, file: Readable, size: int) -> NDArray[np.uint8]:
        start, done = file.tell(), 0
        block = np.empty(size, np.uint8)
        with self._read("an array's bytes"):
            while done < size and (got := file.readinto(block.data[done:])):
                done += got
        if done < size:
            raise ShortReadError(self.name, start, size, done)
        return block

    @contextlib.contextmanager
    def _read(self, expected: str) -> Iterator[None]:
        """Say where it was that something could not be read."""
        # Decompressors and NumPy's parser have many errors without a base of their own.
        try:
            yield
        except (BfrtError, MemoryError):
            raise
        except Exception as error:
            raise SceneError(f"{self.name}: found {said(error)}, expected {expected}") from error
