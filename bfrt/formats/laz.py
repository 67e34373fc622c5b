"""What is to be known of a LAS or LAZ file before laspy and lazrs may have it.

They believe a header's counts: laspy makes four billion records of nothing, and lazrs, which asks
for memory by such a count and gets none, ends the process.
"""

from __future__ import annotations

import contextlib
import struct
from collections.abc import Iterator
from typing import Any

from bfrt.errors import SceneError
from bfrt.formats.source import Source

#: Where the header says how long it is, where points begin, and how many records are between.
SIZES = struct.Struct("<HII")
SIZES_AT = 94

#: Bytes of such a record's own header.
RECORD_BYTES = 54

#: Compressors whose points are in chunks: pointwise and layered.
CHUNKED = (2, 3)

#: Points of a chunk that are decompressed at once, by several threads; larger ones come in parts.
MOST_POINTS = 1 << 18


@contextlib.contextmanager
def asking(source: Source, expected: str, place: str = "") -> Iterator[None]:
    """Give the libraries' errors the file's name and the place.

    They have many of their own for files that are broken; a panic of lazrs is no Exception.
    """
    try:
        yield
    except (KeyboardInterrupt, SystemExit):
        raise
    except BaseException as error:
        raise source.failure(error, expected, place) from error


def check_records(source: Source) -> None:
    """Refuse a header with more records than fit before the points.

    Raises
    ------
    SceneError, ShortReadError
    """
    source.seek(SIZES_AT)
    begin, points, records = SIZES.unpack(source.exactly(SIZES.size))
    if not begin + records * RECORD_BYTES <= points <= source.size:
        raise SceneError(
            f"{source.name}: byte {SIZES_AT}: found a header of {begin} bytes and {records} "
            f"records before points at byte {points} of {source.size}, expected room for them"
        )


def backend_for(source: Source, header: Any, backends: Any) -> Any:
    """What may decompress a file's points: many threads where its chunks are no larger than usual.

    Raises
    ------
    SceneError, ShortReadError
        If there are more chunks than points or bytes.
    """
    import lazrs

    record = header.vlrs.get("LasZipVlr")[0].record_data
    if int.from_bytes(record[:2], "little") not in CHUNKED:
        return backends.Lazrs
    source.seek(header.offset_to_point_data)
    table = _number(source, 8)
    if table == -1:  # its writer could not go back
        source.seek(-8, 2)
        table = _number(source, 8)
    source.seek(table + 4)
    vlr = lazrs.LazVlr(record)
    chunks = _number(source, 4)
    most = min(header.point_count, source.size // vlr.item_size())  # each has a point as it is
    if not 0 <= chunks <= most:
        raise SceneError(
            f"{source.name}: byte {table + 4}: found {chunks} chunks, expected at most {most}"
        )
    source.seek(header.offset_to_point_data)
    sizes = lazrs.read_chunk_table(source, vlr)
    if sum(size for _, size in sizes) > source.size:
        raise SceneError(
            f"{source.name}: byte {table}: found chunks of more bytes than the file has, "
            f"expected at most {source.size}"
        )
    largest = max((points for points, _ in sizes), default=0)
    return backends.LazrsParallel if largest <= MOST_POINTS else backends.Lazrs


def _number(source: Source, size: int) -> int:
    return int.from_bytes(source.exactly(size).tobytes(), "little", signed=True)
