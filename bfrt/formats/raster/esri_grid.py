"""The text of an Esri grid, read once before GDAL does.

GDAL takes 0 for what is no number, and for a last one that is missing, without a word.
"""

from __future__ import annotations

import re

from bfrt.errors import SceneError
from bfrt.formats.lines._lines import Ragged
from bfrt.formats.lines.head import LOOK
from bfrt.formats.raster.facts import Place
from bfrt.formats.source import Source, quoted

#: The header: names, each with its value.
HEADER = re.compile(
    rb"(?:\s*(?:ncols|nrows|[xy]ll(?:corner|center)|cellsize|d[xy]|nodata_value)\s+\S+)*\s*",
    re.IGNORECASE,
)

COMMA, POINT = b",."


def check_grid(path: str, place: Place) -> None:
    """Refuse a grid that has other heights than its header promises.

    Raises
    ------
    SceneError
        If there are more or fewer, or what is no number is among them.
    StreamError
        If the system refuses to read it.
    """
    expected = place.width * place.height
    with Source(path) as source:
        found = HEADER.match(source.head(LOOK))
        assert found is not None  # of any text
        header = found[0].replace(b"\r\n", b"\n").replace(b"\r", b"\n")
        lines = Ragged(1 + header.count(b"\n"), -1)
        heights = 0
        for chunk in source.text(found.end()):
            chunk[chunk == COMMA] = POINT  # as GDAL reads it
            heights += len(lines.parse(chunk)[0])
            if lines.failed:
                raise SceneError(
                    f"{path}: line {lines.line}: found {quoted(lines.token)}, expected a height"
                )
    if heights != expected:
        raise SceneError(
            f"{path}: found {heights} heights, expected {expected}, {place.height} rows of "
            f"{place.width}: the file is truncated or its counts are wrong"
        )
