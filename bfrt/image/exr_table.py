"""What an OpenEXR file has to have at its end: a table of chunks, all of them there.

::

    magic, version | attributes: name, type, size, value ... 0 | offsets, 8 bytes each | chunks

OpenEXR writes the table when it closes a file, and tells nobody that the system has refused it. So
a file that was written is read again: the table, and the head of each chunk.
"""

from __future__ import annotations

import errno
import io
import os
import struct
from pathlib import Path

import numpy as np

from bfrt.errors import StreamError
from bfrt.refusals import calling

MAGIC = 20000630
HEAD = struct.Struct("<iI")
SIZE = struct.Struct("<I")

#: A chunk's own head: its first row, and the bytes behind.
CHUNK = struct.Struct("<iI")

#: Rows of a chunk that is compressed with ZIP.
ROWS = 16


def check_chunks(file: Path, height: int, path: str | os.PathLike[str]) -> None:
    """Refuse a file of `height` scanlines, by ZIP, that is not whole.

    Parameters
    ----------
    file : Path
        What was written.
    path : path
        The file that an error names.

    Raises
    ------
    StreamError
        If it is not.
    """
    with calling(path, "reading back"), file.open("rb") as stream:
        at = _whole_until(stream, height)
    if at is not None:
        raise StreamError(path, at, errno.EIO, "writing a table of chunks, or a chunk,")


def _whole_until(stream: io.BufferedReader, height: int) -> int | None:
    """Return the byte where a file ceases to be what it should be; None if it never does."""
    size = stream.seek(0, os.SEEK_END)
    stream.seek(0)
    if stream.read(HEAD.size)[:4] != MAGIC.to_bytes(4, "little") or not _pass_attributes(stream):
        return 0
    table_at = stream.tell()
    count = -(-height // ROWS)
    table = stream.read(8 * count)
    if len(table) < 8 * count:
        return size
    end = stream.tell()
    for number, begin in enumerate(np.frombuffer(table, "<u8").tolist()):
        if begin != end:  # chunks follow one another
            return table_at + 8 * number
        stream.seek(begin)
        head = stream.read(CHUNK.size)
        if len(head) < CHUNK.size or CHUNK.unpack(head)[0] != number * ROWS:
            return int(min(begin, size))
        end = begin + CHUNK.size + CHUNK.unpack(head)[1]
    return None if end == size else min(end, size)


def _pass_attributes(stream: io.BufferedReader) -> bool:
    """Go behind the header's attributes; tell whether they end."""
    while name := _text(stream):
        if not _text(stream):
            return False
        size = stream.read(SIZE.size)
        if len(size) < SIZE.size:
            return False
        stream.seek(SIZE.unpack(size)[0], os.SEEK_CUR)
    return name is not None


def _text(stream: io.BufferedReader) -> bytes | None:
    """Return the next text that ends with a NUL; None where the file ends first."""
    found = bytearray()
    while byte := stream.read(1):
        if byte == b"\0":
            return bytes(found)
        found += byte
    return None
