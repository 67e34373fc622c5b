"""Points of text: XYZ, CSV, TXT, PTS and ASC."""

from __future__ import annotations

from bfrt.errors import SceneError
from bfrt.formats.column_contents import rows_of_columns
from bfrt.formats.columns import POSITION, ColumnPoints, listed
from bfrt.formats.contents import Row
from bfrt.formats.lines.head import Head, read_head
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
        head = read_head(source, reading.column_names)
        check_names(source, head)
        write_points(ColumnPoints(LineTable(source, head), reading), writer)
        writer.report()


def check_names(source: Source, head: Head) -> None:
    """Refuse columns of which none are named as positions.

    Raises
    ------
    SceneError
    """
    if not set(POSITION) <= set(head.names):
        raise SceneError(
            f"{source.name}: found columns {listed(head.names)}, expected x, y and z, or "
            "column_names= (--column-names), which gives others"
        )


def contents_of_lines(path: str) -> list[Row]:
    """List the columns of points of text, by its first lines; else as `read_lines`.

    Those whose name is not theirs alone go by their numbers.
    """
    with Source(path) as source:
        head = read_head(source, None)
    names = head.names
    keys = [name if names.count(name) == 1 else str(k) for k, name in enumerate(names, 1)]
    return rows_of_columns(keys, head.rows, "text")
