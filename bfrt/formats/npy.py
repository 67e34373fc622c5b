"""NumPy's files: .npy is one array, .npz a zip of several, compressed or not.

Both are read forwards, a block of rows at a time, by `bfrt.formats.npy_array`.
"""

from __future__ import annotations

import zipfile
from collections.abc import Callable
from functools import partial
from typing import Any, cast

from bfrt.errors import SceneError, ShortReadError
from bfrt.formats.array_contents import rows_of_arrays
from bfrt.formats.arrays import write_arrays
from bfrt.formats.contents import POINTS, Row
from bfrt.formats.layouts.layout import arranged
from bfrt.formats.naming import CENTERS, within
from bfrt.formats.npy_array import NpyArray, Readable
from bfrt.formats.object_writer import ObjectWriter, SceneSink
from bfrt.formats.reading import Reading
from bfrt.formats.source import Report, Source, printable
from bfrt.formats.table import Array, Lazy, level, openers_of

#: What the rows of an array without a name become, by their shape.
USES = {(3,): POINTS, (4,): "spheres", (3, 3): "triangles", (9,): "triangles"}


def read_npy(path: str, sink: SceneSink, reading: Reading, report: Report | None = None) -> None:
    """Read an .npy file: spheres (n, 4), points (n, 3), a map (h, w, 3) of points, triangles
    (n, 3, 3) or (n, 9), or records with fields ``x y z`` and others.

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
    writer = ObjectWriter(sink, path, reading)
    records = array.dtype.names is not None
    arrays = Lazy(fields_of(array)) if records else by_shape(array)
    write_arrays(path, arranged(path, arrays, reading), writer)
    writer.report()


def contents_of_npy(path: str) -> list[Row]:
    """List the array of an .npy file, or the fields of its records; else as `read_npy`."""
    array = NpyArray(path, partial(Source, path))
    if array.dtype.names is not None:
        return rows_of_arrays(path, Lazy(fields_of(array)))
    use = USES.get(array.shape[1:], "a map of points" if array.shape[2:] == (3,) else "")
    return [Row("", array.shape, str(array.dtype), use)]


def by_shape(array: NpyArray) -> dict[str, Any]:
    """Return the array under the name that its shape suggests: triangles or positions."""
    if array.shape[1:] in ((3, 3), (9,)):
        return {"triangles": array}
    if array.shape[1:] in ((3,), (4,)) or (len(array.shape) == 3 and array.shape[2] == 3):
        return {CENTERS[0]: array}
    raise SceneError(
        f"{array.name}: found {array.dtype} of shape {array.shape}, expected (n, 3) or (h, w, 3) "
        "points, (n, 4) spheres, (n, 3, 3) or (n, 9) triangles"
    )


def fields_of(array: NpyArray, name: str = "") -> dict[str, Callable[[], Array]]:
    """Return an opener for each field of records, by the array's name and the field's."""
    openers = openers_of(array.dtype, lambda: level(array, 1))
    return {within(name, "/".join(path)): opener for path, opener in openers.items()}


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
    with Source(path) as source, opened_zip(source) as archive:
        arrays = members_of(source, archive)
        writer = ObjectWriter(sink, path, reading)
        write_arrays(path, arranged(path, arrays, reading), writer)
        writer.report()
        if report is not None:
            report(source.size)


def contents_of_npz(path: str) -> list[Row]:
    """List the arrays and fields of an .npz file; else as `read_npz`."""
    with Source(path) as source, opened_zip(source) as archive:
        return rows_of_arrays(path, members_of(source, archive))


def opened_zip(source: Source) -> zipfile.ZipFile:
    """Open a zip, and have what is wrong with its directory be an error of ours."""
    try:
        return zipfile.ZipFile(source)
    except Exception as error:  # of many kinds where its directory is broken
        raise source.failure(error, "a zip of arrays") from error


def members_of(source: Source, archive: zipfile.ZipFile) -> Lazy:
    """Return the arrays of a zip, by the names of its members."""
    openers: dict[str, Callable[[], Array]] = {}
    for member in archive.namelist():
        stem = member.removesuffix(".npy")
        if stem != member:
            name = f"{source.name}: {printable(stem)}"
            opened = partial(NpyArray, name, Member(source, archive, member))
            openers.update(member_of(stem, opened))
    return Lazy(openers)


def member_of(name: str, opened: Callable[[], NpyArray]) -> dict[str, Callable[[], Array]]:
    """Return the openers of a zip member: one by its name, or one for each field of records."""
    try:
        array = opened()
    except (SceneError, ShortReadError):  # nobody may need it
        return {name: opened}
    return {name: opened} if array.dtype.names is None else fields_of(array, name)


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
