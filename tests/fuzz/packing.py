"""Several files as one input, which may be changed anywhere.

::

    offset  bytes    what, of each file
         0      1    its number among the names that there are
         1      4    bytes of the file; fewer are there where the input ends
         5           the file

Any bytes are an input: what is missing makes no file.
"""

from __future__ import annotations

import struct
from collections.abc import Mapping, Sequence
from pathlib import Path

HEAD = struct.Struct("<BI")


def packed(files: Mapping[str, bytes], names: Sequence[str]) -> bytes:
    """Files as one input; `names` are all that there may be."""
    parts = []
    for name, data in files.items():
        parts += [HEAD.pack(names.index(name), len(data)), data]
    return b"".join(parts)


def unpacked(data: bytes, names: Sequence[str]) -> dict[str, bytes]:
    """The files of an input, by their names."""
    files = {}
    at = 0
    while at + HEAD.size <= len(data):
        number, size = HEAD.unpack_from(data, at)
        at += HEAD.size
        files[names[number % len(names)]] = data[at : at + size]
        at += size
    return files


def files_in(folder: Path) -> dict[str, bytes]:
    """The contents of a folder, by names relative to it."""
    return {
        str(path.relative_to(folder)): path.read_bytes()
        for path in sorted(folder.rglob("*"))
        if path.is_file()
    }


def put(files: Mapping[str, bytes], folder: Path) -> None:
    """Make a folder with files."""
    folder.mkdir(parents=True, exist_ok=True)
    for name, data in files.items():
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(data)
