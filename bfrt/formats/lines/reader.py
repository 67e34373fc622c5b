"""Points of text: XYZ, CSV, TXT, PTS and ASC."""

from __future__ import annotations

from bfrt.formats.column_contents import rows_of_columns
from bfrt.formats.columns import ColumnPoints
from bfrt.formats.contents import Row
from bfrt.formats.lines.head import read_head
from bfrt.formats.lines.table import LineTable
from bfrt.formats.object_writer import ObjectWriter, SceneSink
from bfrt.formats.points import write_points
from bfrt.formats.reading import POINTS, Reading
from bfrt.formats.source import Report, Source


def read_lines(path: str, sink: SceneSink, reading: Reading, report: Report | None = None) -> None:
    """Read points of text, one a line: as spheres.

    Raises
    ------
    SceneError
        If it is no such text, or its lines differ, or its count is wrong.
    SettingError
        If a setting does not fit it.
    StreamError
        If the system refuses to read it.
    """
    reading.refuse_all_but(path, "column_names", *POINTS)
    with Source(path, report) as source:
        writer = ObjectWriter(sink, path, reading)
        table = LineTable(source, read_head(source, reading.column_names))
        write_points(ColumnPoints(table, reading), writer)
        writer.report()


def contents_of_lines(path: str) -> list[Row]:
    """List the columns of points of text, by its first lines; else as `read_lines`."""
    with Source(path) as source:
        head = read_head(source, None)
        return rows_of_columns(LineTable(source, head).names, head.rows, "text")
