"""Checks of a LAS or LAZ file before laspy and lazrs read it.

They believe a header's counts: laspy makes four billion records of nothing, and lazrs, which asks
for memory by such a count and gets none, ends the process. Where lazrs is surprised it writes so to
standard error, which nobody can take back: so it gets nothing that it might be surprised by.
"""

from __future__ import annotations

import contextlib
import math
import struct
from collections.abc import Iterator
from typing import Any

from bfrt.errors import SceneError
from bfrt.formats.source import Report, Source

#: Where the header says how long it is, where points begin, and how many records are between.
SIZES = struct.Struct("<HII")
SIZES_AT = 94

#: Such a record's own header: who it is of, its number, and the bytes behind.
RECORD = struct.Struct("<2x16sHH32x")

#: The records that laspy has to know: how points are compressed, and extra bytes of points.
LASZIP = (b"laszip encoded", 22204)
EXTRA = (b"LASF_Spec", 4)

#: An entry of the latter: a name and a description.
ENTRY = struct.Struct("<4x32s124x32s")
TEXTS = ((4, 36), (160, 192))

#: Bytes of what points are made of, by LASzip's numbers; bytes that nobody knows have any size.
ITEM = struct.Struct("<HHH")
ITEMS_AT = 34
SIZES_OF = {6: 20, 7: 8, 8: 6, 9: 29, 10: 30, 11: 6, 12: 8, 13: 29}

#: Points of a chunk where each has its own number.
ANY_NUMBER = 0xFFFFFFFF
CHUNK_AT = 12

#: Bytes before the first chunk, which tell where the table of chunks is.
TABLE_AT_BYTES = 8

#: Compressors whose points are in chunks: pointwise and layered.
CHUNKED = (2, 3)

#: The compressor whose chunks have a layer for each part of a point, all of which it takes memory
#: for: by item the layers, of bytes that nobody knows one each.
LAYERED = 3
LAYERS_OF = {10: 9, 11: 1, 12: 2, 13: 1}
BYTES_IN_LAYERS = 14

#: Points of a chunk that are decompressed at once, by several threads; larger ones come in parts.
MOST_POINTS = 1 << 18
MOST_BYTES = MOST_POINTS << 6


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


class LasSource(Source):
    """Presents a LAS file to laspy with only what points need.

    Records that laspy need not know it passes over, whatever is in them, for here they are
    nobody's; and text is what Python takes for text.

    Raises
    ------
    SceneError, ShortReadError
        If there are more records than fit before the points.
    """

    def __init__(self, path: str, report: Report | None = None) -> None:
        super().__init__(path, report)
        self._patches: list[tuple[int, bytes]] = []
        self._points = 0
        try:
            self._read_records()
        except BaseException:
            self.close()
            raise

    def read_into(self, buffer: memoryview) -> int:
        """Fill a buffer as far as the file goes; return the bytes."""
        start = self.at
        done = super().read_into(buffer)
        if start < self._points:
            for at, data in self._patches:
                first, end = max(at, start), min(at + len(data), start + done)
                if first < end:
                    buffer[first - start : end - start] = data[first - at : end - at]
        return done

    def _read_records(self) -> None:
        self.seek(SIZES_AT)
        begin, points, records = SIZES.unpack(self.exactly(SIZES.size))
        if not begin + records * RECORD.size <= points <= self.size:
            raise SceneError(
                f"{self.name}: byte {SIZES_AT}: found a header of {begin} bytes and {records} "
                f"records before points at byte {points} of {self.size}, expected room for them"
            )
        for _ in range(records):
            if begin + RECORD.size > points:
                break
            self.seek(begin)
            owner, number, size = RECORD.unpack(self.exactly(RECORD.size))
            known = owner.split(b"\0")[0], number
            if known == EXTRA:
                self._patch_texts(begin + RECORD.size, min(begin + RECORD.size + size, points))
            elif known != LASZIP:
                self._patches.append((begin + 2, bytes(len(owner))))
            begin += RECORD.size + size
        self._points = points

    def _patch_texts(self, first: int, end: int) -> None:
        """Have the names of extra bytes be text."""
        for at in range(first, end - ENTRY.size + 1, ENTRY.size):
            self.seek(at)
            texts = ENTRY.unpack(self.exactly(ENTRY.size))
            for text, (place, _) in zip(texts, TEXTS, strict=True):
                self._patches.append((at + place, readable(text)))


def readable(text: bytes) -> bytes:
    """Return UTF-8 text unchanged, and other text with question marks for non-ASCII bytes."""
    try:
        text.decode()
    except UnicodeDecodeError:
        return bytes(byte if byte < 128 else ord("?") for byte in text)
    return text


def backend_for(source: Source, header: Any, backends: Any) -> Any:
    """Choose the decompressor of a file's points: parallel where chunks are of the usual size.

    Raises
    ------
    SceneError, ShortReadError
        If there are more chunks than points or bytes.
    """
    import lazrs

    record = header.vlrs.get("LasZipVlr")[0].record_data
    check_items(source.name, record, header.point_format.size)
    if int.from_bytes(record[:2], "little") not in CHUNKED:
        return backends.Lazrs
    source.seek(header.offset_to_point_data)
    table = _number(source, TABLE_AT_BYTES)
    if table == -1:  # its writer could not go back
        source.seek(-TABLE_AT_BYTES, 2)
        table = _number(source, TABLE_AT_BYTES)
    source.seek(table + 4)
    vlr = lazrs.LazVlr(record)
    chunks = _number(source, 4)
    most = min(header.point_count, source.size // vlr.item_size())  # each has a point as it is
    if not 0 <= chunks <= most:
        raise SceneError(
            f"{source.name}: byte {table + 4}: found {chunks} chunks, expected at most {most}"
        )
    (each,) = struct.unpack_from("<I", record, CHUNK_AT)
    least = 0 if each == ANY_NUMBER else math.ceil(header.point_count / max(each, 1))
    if chunks < least:
        raise SceneError(
            f"{source.name}: byte {table + 4}: found {chunks} chunks of {each} points for "
            f"{header.point_count}, expected {least}"
        )
    source.seek(header.offset_to_point_data)
    sizes = lazrs.read_chunk_table(source, vlr)
    if sum(size for _, size in sizes) > source.size:
        raise SceneError(
            f"{source.name}: byte {table}: found chunks of more bytes than the file has, "
            f"expected at most {source.size}"
        )
    if int.from_bytes(record[:2], "little") == LAYERED:
        check_layers(source, header, record, [size for _, size in sizes])
    largest = max((points for points, _ in sizes), default=0)
    small = largest <= MOST_POINTS and largest * header.point_format.size <= MOST_BYTES
    return backends.LazrsParallel if small else backends.Lazrs


def check_items(name: str, record: bytes, point: int) -> None:
    """Refuse a list of point items whose sizes do not add up to the size of a point.

    Raises
    ------
    SceneError
    """
    items = items_of(record)
    for kind, size, _ in items:
        if size != SIZES_OF.get(kind, size):
            raise SceneError(
                f"{name}: found {size} bytes for LASzip's item {kind}, expected {SIZES_OF[kind]}"
            )
    found = sum(size for _, size, _ in items)
    if found != point:
        raise SceneError(
            f"{name}: found LASzip items of {found} bytes, expected {point}, which a point has"
        )


def items_of(record: bytes) -> list[tuple[int, int, int]]:
    """Return what points are made of: LASzip's number of each item, its bytes and its version."""
    (count,) = struct.unpack_from("<H", record, ITEMS_AT - 2)
    items = [ITEM.unpack_from(record, ITEMS_AT + ITEM.size * k) for k in range(count)]
    return [(kind, size, version) for kind, size, version in items]


def check_layers(source: Source, header: Any, record: bytes, chunks: list[int]) -> None:
    """Refuse chunks whose layers have more bytes than the chunk, which its first bytes tell.

    ::

        first point, points (4 bytes), bytes of each layer (4 each), layers

    Parameters
    ----------
    source : Source
    header : laspy.LasHeader
    record : bytes
        How points are compressed.
    chunks : list of int
        Bytes of each chunk.

    Raises
    ------
    SceneError, ShortReadError
    """
    layers = sum(
        size if kind == BYTES_IN_LAYERS else LAYERS_OF.get(kind, 0)
        for kind, size, _ in items_of(record)
    )
    at = header.offset_to_point_data + TABLE_AT_BYTES
    for size in chunks:
        if size:
            source.seek(at + header.point_format.size + 4)
            found = sum(struct.unpack(f"<{layers}I", source.exactly(4 * layers)))
            room = size - header.point_format.size - 4 - 4 * layers
            if found > room:
                raise SceneError(
                    f"{source.name}: byte {at}: found layers of {found} bytes in a chunk of "
                    f"{size}, expected at most {max(room, 0)}"
                )
        at += size


def _number(source: Source, size: int) -> int:
    return int.from_bytes(source.exactly(size).tobytes(), "little", signed=True)
