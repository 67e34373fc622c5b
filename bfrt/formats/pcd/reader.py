"""Points of a PCD file."""

from __future__ import annotations

from bfrt.formats.columns import ColumnPoints
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
