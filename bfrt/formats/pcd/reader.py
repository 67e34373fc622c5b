"""Points of a PCD file."""

from __future__ import annotations

from bfrt.formats.column_contents import use_of
from bfrt.formats.columns import ColumnPoints
from bfrt.formats.contents import Row
from bfrt.formats.object_writer import ObjectWriter, SceneSink
from bfrt.formats.pcd.fields import PcdTable
from bfrt.formats.pcd.header import read_header
from bfrt.formats.points import write_points
from bfrt.formats.reading import POINTS, Reading
from bfrt.formats.source import Report, Source


def read_pcd(path: str, sink: SceneSink, reading: Reading, report: Report | None = None) -> None:
    """Read a PCD file: its points as spheres.

    Raises
    ------
    SceneError, ShortReadError
        If it is no PCD, or is not as its header says.
    SettingError
        If a setting does not fit it.
    StreamError
        If the system refuses to read it.
    """
    reading.refuse_all_but(path, *POINTS)
    with Source(path, report) as source:
        writer = ObjectWriter(sink, path, reading)
        write_points(ColumnPoints(PcdTable(source, read_header(source)), reading), writer)
        writer.report()


def contents_of_pcd(path: str) -> list[Row]:
    """List the fields of a PCD file by its header, and colors in their bits; else as `read_pcd`."""
    with Source(path) as source:
        header = read_header(source)
        names = PcdTable(source, header).names
    rows = []
    for field in header.fields:
        shape = (header.rows,) if field.numbers == 1 else (header.rows, field.numbers)
        use = use_of(field.name, names) if names.count(field.name) == 1 else ""
        rows.append(Row(field.name, shape, str(field.dtype), use))
    packed = [name for name in names if name not in {field.name for field in header.fields}]
    return rows + [Row(name, (header.rows,), "8 bits", use_of(name, names)) for name in packed]
