"""What a store's header says about a file, and whether the file is so."""

from __future__ import annotations

import zlib
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from bfrt.errors import StoreError
from bfrt.refusals import refused

#: Opens a file of a path and flags: gives a descriptor, as the ``opener`` of Python's `open`.
Opener = Callable[[str, int], int]


@dataclass(frozen=True)
class FileFacts:
    """Holds what the header says about a file."""

    bytes: int
    crc32: int


def damaged(path: Path, facts: FileFacts) -> StoreError:
    return StoreError(
        f"{path}: the contents differ from what was written: "
        f"expected {facts.bytes} bytes with CRC-32 {facts.crc32:08x}"
    )


def checksum_of(path: Path, start: int = 0, opener: Opener | None = None) -> tuple[int, int]:
    """Return the CRC-32 and the length of a file from byte `start` on, read in blocks."""
    crc = length = 0
    try:
        with open(path, "rb", opener=opener) as file:
            file.seek(start)
            while block := file.read(1 << 22):
                crc = zlib.crc32(block, crc)
                length += len(block)
    except OSError as error:
        raise refused(path, start + length, error, "reading") from error
    return crc, length


def check_size(path: Path, size: int, found: int) -> None:
    """Refuse a file of `found` bytes that should have `size`.

    Raises
    ------
    StoreError
        If they differ.
    """
    if found != size:
        raise StoreError(f"{path}: found {found} bytes, expected {size}: the store is truncated")
