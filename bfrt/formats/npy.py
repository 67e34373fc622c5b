"""NumPy's files: .npy is one array, .npz a zip of several, compressed or not.

Both are read forwards, a block of rows at a time: neither is mapped, so that a disk that fails is
an error and not the end of the process.
"""

from __future__ import annotations

import contextlib
import math
import zipfile
import zlib
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from bfrt.errors import SceneError, ShortReadError
from bfrt.formats.arrays import CENTERS, write_arrays
from bfrt.formats.outlet import Outlet, SceneSink
from bfrt.formats.reading import Reading
from bfrt.formats.source import Report, Source
from bfrt.streams.aside import refused

#: What a broken zip is told by.
BROKEN = (zipfile.BadZipFile, zlib.error, EOFError, RuntimeError, NotImplementedError, ValueError)

#: Bytes of a header: NumPy takes no more either.
HEADER_BYTES = 10_000


class Readable(Protocol):
    """What an array is read from, forwards."""

    def read(self, size: int = ..., /) -> bytes: ...

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
    """

    def __init__(self, name: str, open_it: Callable[[], Readable]) -> None:
        self.name = name
        self._open = open_it
        with contextlib.closing(open_it()) as file:
            self.shape, self.dtype = self._header(file)

    def _header(self, file: Readable) -> tuple[tuple[int, ...], np.dtype[Any]]:
        try:
            version = np.lib.format.read_magic(file)
            read = np.lib.format.read_array_header_2_0
            if version == (1, 0):
                read = np.lib.format.read_array_header_1_0
            elif version not in ((2, 0), (3, 0)):
                raise ValueError(f"version {version}")
            shape, fortran, dtype = read(file, max_header_size=HEADER_BYTES)
        except BROKEN as error:
            raise SceneError(
                f"{self.name}: found {str(error).splitlines()[0]!r:.200}, "
                "expected NumPy's header of an array"
            ) from None
        whole = all(isinstance(n, int) and not isinstance(n, bool) and n >= 0 for n in shape)
        if not shape or not whole or dtype.hasobject or (fortran and len(shape) > 1):
            order = "Fortran" if fortran else "C"
            raise SceneError(
                f"{self.name}: found {dtype} of shape {shape} in {order} order, expected numbers "
                "in rows, in C order"
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
                block = self._exactly(file, n * row, (self.shape[0] - left) * row)
                yield np.frombuffer(block, self.dtype).reshape(n, *self.shape[1:])
                left -= n
            if row and self._read(file, 1):
                raise SceneError(
                    f"{self.name}: found more bytes than an array of shape {self.shape} has, "
                    "expected its end"
                )

    def _exactly(self, file: Readable, size: int, done: int) -> bytes:
        block = bytearray()
        while len(block) < size:
            part = self._read(file, size - len(block))
            if not part:
                raise ShortReadError(self.name, done + len(block), size, len(block))
            block += part
        return bytes(block)

    def _read(self, file: Readable, size: int) -> bytes:
        try:
            return file.read(size)
        except BROKEN as error:
            raise SceneError(
                f"{self.name}: found {str(error)!r:.200}, expected an array's bytes"
            ) from None


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
    array = NpyArray(path, lambda: Source(path, report))
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
        self.name = f"{array.name}: {' '.join(fields)}"
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
    """The fields of an array of records, and its positions where they are three."""
    if len(array.shape) != 1:
        raise SceneError(f"{array.name}: found records of shape {array.shape}, expected (n,)")
    found = {name: Field(array, name) for name in array.dtype.names or ()}
    if all(name in found for name in "xyz"):
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
    try:
        archive = zipfile.ZipFile(path)
    except OSError as error:
        raise refused(path, 0, error, "opening") from error
    except BROKEN as error:
        raise SceneError(f"{path}: found {str(error)!r:.200}, expected a zip of arrays") from None
    with archive:
        arrays = {}
        for member in archive.namelist():
            stem = member.removesuffix(".npy")
            if stem != member:
                arrays[stem] = NpyArray(f"{path}: {stem}", Member(archive, member, path))
        outlet = Outlet(sink, path, reading)
        write_arrays(path, arrays, outlet)
        outlet.report()
    if report is not None:
        report(Path(path).stat().st_size)


class Member:
    """Opens a file of a zip."""

    def __init__(self, archive: zipfile.ZipFile, member: str, path: str) -> None:
        self._archive, self._member, self._path = archive, member, path

    def __call__(self) -> Readable:
        try:
            return self._archive.open(self._member)
        except OSError as error:
            raise refused(self._path, 0, error, "reading") from error
        except BROKEN as error:
            raise SceneError(
                f"{self._path}: {self._member}: found {str(error)!r:.200}, expected an array"
            ) from None
