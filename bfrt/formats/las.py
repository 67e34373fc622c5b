"""LAS and LAZ: points of scans, by laspy, a chunk of points at a time."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bfrt.errors import SceneError, SettingError
from bfrt.formats.colors import full_of
from bfrt.formats.contents import COLOR, OWN_COLORS, RADIUS, Row
from bfrt.formats.contents import POINTS as POSITIONS
from bfrt.formats.laz import LasSource, asking, backend_for
from bfrt.formats.object_writer import ObjectWriter, SceneSink
from bfrt.formats.points import POINTS_AT_ONCE, PointBlock, write_points
from bfrt.formats.reading import COLORS, POINTS, Reading
from bfrt.formats.source import Report, Source, printable

#: Bytes of a point that has much; of points that have more fewer are read at once.
POINT_BYTES = 64


class Scan:
    """Reads the points of a LAS or LAZ scan: a `bfrt.formats.points.Points`."""

    def __init__(self, source: Source, laspy: Any, reading: Reading) -> None:
        self.name = source.name
        self._source = source
        self._laspy = laspy
        self._asked = reading.columns
        column = reading.radius_column
        self._radius = () if column is None else (column,)
        self.painted = bool(self._asked)
        self._full = 1.0
        with self.opened() as file:
            dimensions = file.header.point_format.dimensions
        there = {*"xyz", *(each.name for each in dimensions if each.num_elements == 1)}
        for name in (*self._radius, *self._asked):
            if name not in there:
                raise SettingError(
                    f"{self.name}: found no dimension {name!r}, expected one of "
                    f"{', '.join(map(printable, sorted(there)))}"
                )
        if len(self._asked) == 3:  # the standard wants 16 bits, which not all writers know
            self._full = full_of(self.name, np.dtype("u2"), self.numbers())

    def opened(self) -> Any:
        """Open the scan: laspy's reader."""
        with asking(self._source, "a LAS or LAZ file"):
            self._source.seek(0)
            file = self._laspy.open(self._source, closefd=False, read_evlrs=False)
            if file.header.are_points_compressed and file.header.point_count:
                file.laz_backend = backend_for(self._source, file.header, self._laspy.LazBackend)
            self._source.seek(file.header.offset_to_point_data)
            return file

    def _chunks(self) -> Iterator[Any]:
        """Yield all points in chunks, as many as the header says."""
        done = 0
        with self.opened() as file:
            promised = file.header.point_count
            size = max(file.header.point_format.size, POINT_BYTES)
            chunks = file.chunk_iterator(max(POINTS_AT_ONCE * POINT_BYTES // size, 1))
            while True:
                with asking(self._source, f"{promised} points", f"point {done}: "):
                    chunk = next(chunks, None)
                if chunk is None:
                    break
                done += len(chunk)
                yield chunk
        if done != promised:
            raise SceneError(
                f"{self.name}: found {done} points, expected {promised}: the file is truncated "
                "or its count is wrong"
            )

    def blocks(self) -> Iterator[PointBlock]:
        for chunk in self._chunks():
            centers = np.stack([numbers_of(chunk, axis) for axis in "xyz"], axis=-1)
            radii = numbers_of(chunk, self._radius[0]) if self._radius else None
            yield PointBlock(centers, radii, self._values(chunk) if self._asked else None)

    def _values(self, chunk: Any) -> NDArray[Any]:
        columns = [numbers_of(chunk, name) for name in self._asked]
        return columns[0] if len(columns) == 1 else np.stack(columns, axis=-1) / self._full

    def numbers(self) -> Iterator[NDArray[Any]]:
        return (self._values(chunk) for chunk in self._chunks())


def numbers_of(chunk: Any, name: str) -> NDArray[np.float64]:
    """Return a dimension of some points, (n,): inf, which others refuse, for what is too large."""
    with np.errstate(all="ignore"):
        return np.asarray(chunk[name], np.float64)


def read_las(path: str, sink: SceneSink, reading: Reading, report: Report | None = None) -> None:
    """Read a LAS or LAZ file: its points as spheres.

    Raises
    ------
    SceneError
        If it is none, or is truncated.
    SettingError
        If a setting does not fit it, or laspy is missing.
    StreamError
        If the system refuses to read it.
    """
    reading.refuse_all_but(path, *POINTS)
    laspy = library_for(path)
    with LasSource(path) as source:
        writer = ObjectWriter(sink, path, reading)
        write_points(Scan(source, laspy, reading), writer)
        writer.report()
        if report is not None:
            report(source.size)


def library_for(path: str) -> Any:
    """Return laspy.

    Raises
    ------
    SettingError
        If it is missing.
    """
    try:
        import laspy
        import lazrs  # noqa: F401
    except ImportError:
        raise SettingError(f"{path}: LAS needs laspy and lazrs: install bfrt[las]") from None
    return laspy


def contents_of_las(path: str) -> list[Row]:
    """List the dimensions of a LAS or LAZ file by its header; else as `read_las`."""
    laspy = library_for(path)
    with LasSource(path) as source, Scan(source, laspy, Reading()).opened() as file:
        count, form = file.header.point_count, file.header.point_format
        own = {*COLORS} & {*form.dimension_names}
        rows = [Row("x y z", (count,), "float64", POSITIONS)]
        for each in form.dimensions:
            shape = (count,) if each.num_elements == 1 else (count, each.num_elements)
            kind = "" if each.dtype is None else str(each.dtype.base)
            name = printable(each.name)
            use = f"{COLOR.format(name)}, {RADIUS.format(name)}" if len(shape) == 1 else ""
            if each.name in COLORS and len(own) == len(COLORS):
                use = OWN_COLORS
            rows.append(Row(name, shape, kind or f"{each.num_bits} bits", use))
        return rows
