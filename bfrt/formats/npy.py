"""NumPy's files: .npy is one array, .npz a zip of several, compressed or not.

Both are read forwards, a block of rows at a time: neither is mapped, so that a disk that fails is
an error and not the end of the process.
"""

from __future__ import annotations

import contextlib
import math
import zipfile
from collections.abc import Callable, Iterator
from functools import partial
from typing import Any, Protocol, cast

import numpy as np
from numpy.typing import NDArray

from bfrt.errors import BfrtError, SceneError, ShortReadError
from bfrt.formats.arrays import CENTERS, Lazy, write_arrays
from bfrt.formats.outlet import Outlet, SceneSink
from bfrt.formats.reading import Reading
from bfrt.formats.source import Report, Source, printable, said

#: Bytes of a header: NumPy takes no more either.
HEADER_BYTES = 10_000


class Readable(Protocol):
    """What an array is read from, forwards."""

    def read(self, size: int = ..., /) -> bytes: ...

    def readinto(self, buffer: Any, /) -> int: ...

    def tell(self) -> int: ...

    def close(self) -> None: ...


class NpyArray:
    """An array in NumPy's format.

    Parameters
    ----------
    name : str
        For errors.
    open_it : callable
        Opens its bytes from their begin.

    Raises
    ------
    SceneError
        If they are no array of numbers in C order.
    StreamError
        If the system refuses to read them.
    """

    def __init__(self, name: str, open_it: Callable[[], Readable]) -> None:
        self.name = name
        self._open = open_it
        with contextlib.closing(open_it()) as file:
            self.shape, self.dtype = self._header(file)

    def _header(self, file: Readable) -> tuple[tuple[int, ...], np.dtype[Any]]:
        with self._read("NumPy's header of an array"):
            version = np.lib.format.read_magic(file)
            read = np.lib.format.read_array_header_2_0
            if version == (1, 0):
                read = np.lib.format.read_array_header_1_0
            elif version not in ((2, 0), (3, 0)):
                raise ValueError(f"version {version}")
            shape, fortran, dtype = read(file, max_header_size=HEADER_BYTES)
            if version == (3, 0) and dtype.names:  # which is 2.0 with names of UTF-8
                dtype.names = tuple(name.encode("latin1").decode() for name in dtype.names)
        whole = all(isinstance(n, int) and not isinstance(n, bool) and n >= 0 for n in shape)
        plain = not dtype.hasobject and dtype.subdtype is None
        if not shape or not whole or not plain or (fortran and len(shape) > 1):
            order = "Fortran" if fortran else "C"
            raise SceneError(
                f"{self.name}: found {printable(str(dtype))} of shape {shape} in {order} order, "
                "expected numbers in rows, in C order"
            )
        return shape, dtype

    def blocks(self, rows: int) -> Iterator[NDArray[Any]]:
        """All rows, `rows` at a time."""
        row = math.prod(self.shape[1:]) * self.dtype.itemsize
        left = self.shape[0]
        with contextlib.closing(self._open()) as file:
            self._header(file)
            while left and row:
                n = min(rows, left)
                yield self._exactly(file, n * row).view(self.dtype).reshape(n, *self.shape[1:])
                left -= n
            with self._read("its end"):
                more = file.read(1)
            if row and more:
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
        except BfrtError:
            raise
        except Exception as error:
            raise SceneError(f"{self.name}: found {said(error)}, expected {expected}") from error


def read_npy(path: str, sink: SceneSink, reading: Reading, report: Report | None = None) -> None:
    """Read an .npy file: spheres (n, 4), points (n, 3), triangles (n, 3, 3) or (n, 9), or rows
    with fields ``x y z`` and others.

    Raises
    ------
    SceneError, ShortReadError
        If it is no such array.
    SettingError
        If a setting does not fit it.
    StreamError
        If the system refuses to read it.
    """
    array = NpyArray(path, partial(Source, path, report))
    outlet = Outlet(sink, path, reading)
    write_arrays(path, fields_of(array) if array.dtype.names else by_shape(array), outlet)
    outlet.report()


def by_shape(array: NpyArray) -> dict[str, Any]:
    """The array under the name that its shape tells."""
    if array.shape[1:] in ((3, 3), (9,)):
        return {"triangles": array}
    if array.shape[1:] in ((3,), (4,)):
        return {CENTERS[0]: array}
    raise SceneError(
        f"{array.name}: found {array.dtype} of shape {array.shape}, expected (n, 3) points, "
        "(n, 4) spheres, (n, 3, 3) or (n, 9) triangles"
    )


class Field:
    """Fields of rows as an array: one as a column, several side by side."""

    def __init__(self, array: NpyArray, *fields: str) -> None:
        self.name = f"{array.name}: {printable(' '.join(fields))}"
        self._array = array
        self._fields = fields
        first: np.dtype[Any] = array.dtype[fields[0]]
        self.dtype = np.result_type(*(array.dtype[field].base for field in fields))
        beside = (len(fields),) if len(fields) > 1 else first.shape
        self.shape = (array.shape[0], *beside)

    def blocks(self, rows: int) -> Iterator[NDArray[Any]]:
        """All rows, `rows` at a time."""
        for block in self._array.blocks(rows):
            if len(self._fields) > 1:
                yield np.stack([block[field] for field in self._fields], axis=-1)
            else:
                yield np.ascontiguousarray(block[self._fields[0]])


def fields_of(array: NpyArray) -> dict[str, Any]:
    """The fields of an array of records, and its positions where they are three numbers."""
    names = array.dtype.names or ()
    if len(array.shape) != 1:
        raise SceneError(f"{array.name}: found records of shape {array.shape}, expected (n,)")
    found = {name: Field(array, name) for name in names}
    if all(name in names and array.dtype[name].kind in "fiu" for name in "xyz"):
        found[CENTERS[0]] = Field(array, "x", "y", "z")
    return found


def read_npz(path: str, sink: SceneSink, reading: Reading, report: Report | None = None) -> None:
    """Read an .npz file, whose arrays' names tell what they are: `bfrt.formats.arrays`.

    Raises
    ------
    SceneError, ShortReadError
        If it is no zip of arrays, or they make no scene.
    SettingError
        If a setting does not fit them.
    StreamError
        If the system refuses to read it.
    """
    with Source(path) as source:
        try:
            archive = zipfile.ZipFile(source)
        except Exception as error:  # of many kinds where its directory is broken
            raise source.failure(error, "a zip of arrays") from error
        with archive:
            openers = {}
            for member in archive.namelist():
                stem = member.removesuffix(".npy")
                if stem != member:
                    name = f"{path}: {printable(stem)}"
                    openers[stem] = partial(NpyArray, name, Member(source, archive, member))
            outlet = Outlet(sink, path, reading)
            write_arrays(path, Lazy(openers), outlet)
            outlet.report()
        if report is not None:
            report(source.size)


class Member:
    """Opens a file of a zip."""

    def __init__(self, source: Source, archive: zipfile.ZipFile, member: str) -> None:
        self._source, self._archive, self._member = source, archive, member

    def __call__(self) -> Readable:
        try:
            return cast(zipfile.ZipExtFile, self._archive.open(self._member))
        except Exception as error:  # encrypted, in a way that is not known, or broken
            place = f"{printable(self._member)}: "
            raise self._source.failure(error, "an array", place) from error
