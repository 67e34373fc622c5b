"""STL: triangles one after the other, of bytes or of text.

Normals and attribute bytes are passed over: bfrt works normals out of the vertices.
"""

from __future__ import annotations

import logging
from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bfrt.errors import SceneError
from bfrt.formats._stl import Facets
from bfrt.formats.contents import Row
from bfrt.formats.object_writer import ObjectWriter, SceneSink
from bfrt.formats.reading import Reading
from bfrt.formats.source import PADDING, Report, Source, quoted

log = logging.getLogger(__name__)

FACET = np.dtype([("normal", "<f4", 3), ("vertices", "<f4", 9), ("attribute", "<u2")])
HEADER = 80
COUNT_END = HEADER + 4

#: Bytes of a file that are looked at to tell text.
LOOK = 512

#: What text may have behind the line of its name.
SECOND = (b"facet", b"endsolid", b"end ", b"color", b"solid")

#: Facets that are read at once.
FACETS_AT_ONCE = 1 << 16


def read_stl(path: str, sink: SceneSink, reading: Reading, report: Report | None = None) -> None:
    """Read an STL file, of text where it looks like it and has not just its count's size.

    Raises
    ------
    SceneError
        If it is neither, or has fewer facets than its count.
    SettingError
        If a setting has no meaning here.
    StreamError
        If the system refuses to read it.
    """
    reading.refuse_all_but(path, "skip_invalid")
    with Source(path, report) as source:
        writer = ObjectWriter(sink, path, reading)
        for block in facets_of(source):
            writer.triangles(block)
        writer.report()


def contents_of_stl(path: str) -> list[Row]:
    """Tell how many facets an STL file's count says, or that it is text; else as `read_stl`."""
    with Source(path) as source:
        count, behind = count_of(source)
        if behind and is_text(source.head(LOOK)):
            return [Row("facet", (), "text", "triangles")]
        check_count(source, count, behind)
        return [Row("facet", (count,), "float32", "triangles")]


def count_of(source: Source) -> tuple[int, int]:
    """Return the count of a file of bytes, and how many are behind so many facets."""
    source.seek(HEADER)
    count = int.from_bytes(source.read(COUNT_END - HEADER), "little")
    return count, source.size - COUNT_END - count * FACET.itemsize


def facets_of(source: Source) -> Iterator[NDArray[Any]]:
    """Yield the vertices of all facets, (n, 9) at a time."""
    count, behind = count_of(source)
    if behind and is_text(source.head(LOOK)):
        yield from text_facets(source)
        return
    check_count(source, count, behind)
    source.seek(COUNT_END)
    for block in source.blocks(FACET, count, FACETS_AT_ONCE):
        yield np.ascontiguousarray(block["vertices"])


def is_text(head: bytes) -> bool:
    """Tell whether a file is text: it begins with solid, and NULs, if any, only pad its name.

    Files of bytes may begin with solid too, but have the NULs of their count.
    """
    text = head.lower().lstrip()
    _, _, rest = text.replace(b"\r", b"\n").partition(b"\n")
    return text.startswith(b"solid") and (
        b"\0" not in text or rest.lstrip(PADDING).startswith(SECOND)
    )


def check_count(source: Source, count: int, behind: int) -> None:
    """Refuse a file of bytes that has fewer facets than its count, or some where that is none.

    What is behind them is passed over: a stray line's end, or what a program keeps for itself.
    """
    if source.size < COUNT_END:
        raise SceneError(
            f"{source.name}: byte {HEADER}: found {source.size} bytes, expected an STL file of "
            f"{COUNT_END} or more"
        )
    if behind < 0:
        raise SceneError(
            f"{source.name}: byte {HEADER}: found {source.size} bytes and a count of {count} "
            f"facets, expected {source.size - behind} bytes: the file is truncated or its count "
            "is wrong"
        )
    if count == 0 and behind >= FACET.itemsize:
        raise SceneError(
            f"{source.name}: byte {HEADER}: found a count of 0 facets and {behind} bytes behind "
            f"it, expected a count of {behind // FACET.itemsize}: it was not written, or this is "
            "no STL file"
        )
    if behind:
        log.warning(
            "%s: %d bytes behind the last facet were passed over: its count may be wrong",
            source.name,
            behind,
        )


def text_facets(source: Source) -> Iterator[NDArray[np.float64]]:
    """Yield the vertices of facets of text, (n, 9) at a time."""
    facets = Facets()
    for chunk in source.text():
        text = chunk[1:-1]
        if not text.all():  # NULs that pad the name, or the file
            text[text == 0] = ord(" ")
        yield facets.parse(chunk)
        if facets.failed:
            raise SceneError(
                f"{source.name}: line {facets.line}: found {quoted(facets.token)}, "
                f"expected {facets.expected}"
            )
    if not facets.complete:
        raise SceneError(
            f"{source.name}: line {facets.line}: found the file's end, expected {facets.expected}"
        )
