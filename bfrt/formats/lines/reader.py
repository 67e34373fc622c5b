"""Points of text: XYZ, CSV, TXT, PTS and ASC."""

from __future__ import annotations

from bfrt.formats.columns import ColumnPoints
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
