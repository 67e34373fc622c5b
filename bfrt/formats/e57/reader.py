"""Points of an E57 file."""

from __future__ import annotations

import struct
from contextlib import closing

from bfrt.errors import SceneError, SettingError
from bfrt.formats.column_contents import rows_of_columns
from bfrt.formats.columns import ColumnPoints
from bfrt.formats.contents import Row
from bfrt.formats.e57.remote import RemoteTable
from bfrt.formats.object_writer import ObjectWriter, SceneSink
from bfrt.formats.points import write_points
from bfrt.formats.reading import POINTS, Reading
from bfrt.formats.remote.process import is_installed
from bfrt.formats.source import Report, Source, quoted

#: What a file begins with: a word, a version, its bytes, where its XML is, how long that is, and
#: the bytes of a page.
HEADER = struct.Struct("<8sIIQQQQ")
WORD = b"ASTM-E57"

#: Bytes of a page, and of them those before its checksum.
PAGE, CHECKED = 1024, 1020

#: What XML begins with, and what in it may name other files, or grow without end.
XML, DOCTYPE = b"<?xml", b"<!DOCTYPE"

#: Bytes of XML, which the library holds whole as a tree of several times as many.
MOST_XML = 4 << 20


def read_e57(path: str, sink: SceneSink, reading: Reading, report: Report | None = None) -> None:
    """Read an E57 file: the points of all its scans as spheres, where their poses put them.

    Raises
    ------
    SceneError
        If it is no E57 file, or is broken or truncated.
    SettingError
        If a setting does not fit it, or pye57 is missing.
    StreamError
        If the system refuses to read it.
    """
    reading.refuse_all_but(path, *POINTS)
    check_library(path)
    with Source(path) as source:
        check_header(source)
        with closing(RemoteTable(path, source.size, report)) as table:
            writer = ObjectWriter(sink, path, reading)
            write_points(ColumnPoints(table, reading), writer)
            writer.report()
        if report is not None:
            report(source.size)


def contents_of_e57(path: str) -> list[Row]:
    """List the columns that all scans of an E57 file have; else as `read_e57`."""
    check_library(path)
    with Source(path) as source:
        check_header(source)
        with closing(RemoteTable(path, source.size)) as table:
            return rows_of_columns(table.names, table.count, str(table.dtype))


def check_library(path: str) -> None:
    """Refuse an E57 file where pye57 is missing."""
    if not is_installed("pye57"):
        raise SettingError(f"{path}: E57 needs pye57: install bfrt[e57]")


def check_header(source: Source) -> None:
    """Refuse a file whose header is none, before the library believes what it says.

    Raises
    ------
    SceneError, ShortReadError
        If it is none, or says more than there is, or XML that is too long or declares entities.
    """
    word, _, _, size, at, xml, page = HEADER.unpack(source.exactly(HEADER.size))
    if word != WORD:
        raise SceneError(f"{source.name}: found {quoted(word)}, expected {WORD.decode()}")
    if size != source.size:
        raise SceneError(
            f"{source.name}: byte 16: found {source.size} bytes, expected {size}: the file is "
            "truncated or its size is wrong"
        )
    if page != PAGE:
        raise SceneError(f"{source.name}: byte 40: found pages of {page} bytes, expected {PAGE}")
    if not at + xml <= size:
        raise SceneError(
            f"{source.name}: byte 24: found {xml} bytes of XML at byte {at} of {size}, expected "
            "them inside"
        )
    if xml > MOST_XML:
        raise SceneError(
            f"{source.name}: byte 32: found {xml} bytes of XML, expected {MOST_XML} or fewer"
        )
    text = xml_of(source, at, xml)
    if not text.startswith(XML) or DOCTYPE in text:
        raise SceneError(
            f"{source.name}: byte {at}: found {quoted(text[: len(XML)])}"
            f"{' and a DOCTYPE' if DOCTYPE in text else ''}, expected {XML.decode()} without one: "
            "it may name any file"
        )


def xml_of(source: Source, at: int, size: int) -> bytes:
    """Return the XML that begins at a byte of the file, without the checksums of its pages."""
    first, begin = divmod(at, PAGE)
    source.seek(first * PAGE)
    raw = source.read((-(-(begin + size) // CHECKED) + 1) * PAGE)
    bare = b"".join(raw[k : k + CHECKED] for k in range(0, len(raw), PAGE))
    return bare[begin : begin + size]
