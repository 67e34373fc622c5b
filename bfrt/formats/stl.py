"""STL: triangles one after the other, of bytes or of text.

Normals and attribute bytes are passed over: bfrt works normals out of the vertices.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bfrt.errors import SceneError
from bfrt.formats._stl import Facets
from bfrt.formats.outlet import Outlet, SceneSink
from bfrt.formats.reading import Reading
from bfrt.formats.source import Report, Source, shown

FACET = np.dtype([("normal", "<f4", 3), ("vertices", "<f4", 9), ("attribute", "<u2")])
HEADER = 80
COUNT_END = HEADER + 4

#: Bytes of a file that are looked at: text has no NUL among them.
LOOK = 512

#: Facets that are read at once.
BLOCK = 1 << 16


def read_stl(path: str, sink: SceneSink, reading: Reading, report: Report | None = None) -> None:
    """Read an STL file: of bytes where its size is that of its count, else of text.

    Raises
    ------
    SceneError
        If it is neither.
    SettingError
        If a setting has no meaning here.
    StreamError
        If the system refuses to read it.
    """
    reading.refuse_all_but(path, "skip_invalid")
    with Source(path, report) as source:
        outlet = Outlet(sink, path, reading)
        for block in facets_of(source):
            outlet.triangles(block)
        outlet.report()


def facets_of(source: Source) -> Iterator[NDArray[Any]]:
    """The vertices of all facets, (n, 9) at a time."""
    head = source.read(LOOK)
    count = int.from_bytes(head[HEADER:COUNT_END], "little") if len(head) >= COUNT_END else -1
    if count >= 0 and source.size == COUNT_END + count * FACET.itemsize:
        source.seek(COUNT_END)
        for block in source.blocks(FACET, count, BLOCK):
            yield np.ascontiguousarray(block["vertices"])
        return
    if head.lstrip()[:5].lower() != b"solid" or b"\0" in head:
        raise SceneError(
            f"{source.name}: byte {HEADER}: "
            + (
                f"found {source.size} bytes and a count of {count} facets, expected "
                f"{COUNT_END + count * FACET.itemsize} bytes: the file is truncated or its "
                "count is wrong"
                if count >= 0
                else f"found {source.size} bytes, expected an STL file of {COUNT_END} or more"
            )
        )
    yield from text_facets(source)


def text_facets(source: Source) -> Iterator[NDArray[np.float64]]:
    """The vertices of facets of text."""
    facets = Facets()
    source.seek(0)
    for chunk in source.text():
        yield facets.parse(chunk)
        if facets.failed:
            raise SceneError(
                f"{source.name}: line {facets.line}: found {shown(facets.token)}, "
                f"expected {facets.expected}"
            )
    if not facets.complete:
        raise SceneError(
            f"{source.name}: line {facets.line}: found the file's end, expected {facets.expected}"
        )
