"""What a store's header says about a file, and whether the file is so."""

from __future__ import annotations

import zlib
from dataclasses import dataclass
from pathlib import Path

from bfrt.errors import StoreError
from bfrt.refusals import refused


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


def checksum_of(path: Path, start: int = 0) -> tuple[int, int]:
    """Return the CRC-32 and the length of a file from byte `start` on, read in blocks."""
    crc = length = 0
    try:
        with path.open("rb") as file:
            file.seek(start)
            while block := file.read(1 << 22):
                crc = zlib.crc32(block, crc)
                length += len(block)
    except OSError as error:
        raise refused(path, start + length, error, "reading") from error
    return crc, length


def check_size(path: Path, size: int) -> None:
    """Refuse a file that is missing, or of another size than `size` bytes.

    Raises
    ------
    StoreError
        If it is.
    StreamError
        As the system refuses.
    """
    try:
        found = path.stat().st_size
    except (FileNotFoundError, NotADirectoryError):
        raise StoreError(f"{path}: the file is missing: expected {size} bytes") from None
    except OSError as error:
        raise refused(path, 0, error, "examining") from error
    if found != size:
        raise StoreError(f"{path}: found {found} bytes, expected {size}: the store is truncated")
