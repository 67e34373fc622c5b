"""Checksums made anew, so that none stands in the way of what was changed."""

from __future__ import annotations

import json
import zlib
from pathlib import Path
from typing import Any

import numpy as np

from bfrt.grid.marks_layout import CRC, HEADER
from bfrt.store.header import header_text

#: Where the header of marks ends, and its fields: the store's checksum, and that of tables.
TABLES = HEADER.size + CRC.size
OF_STORE, OF_TABLES = 6, 9


def sign_store(path: Path, header: dict[str, Any]) -> None:
    """Write a store's header, and let palette and marks be of it."""
    header["palette"]["crc32"] = zlib.crc32((path / "palette").read_bytes())
    text = header_text(header)
    (path / "scene.json").write_text(text)
    for marks in path.glob("*/marks"):
        data = marks.read_bytes()
        if len(data) >= TABLES:
            marks.write_bytes(signed_marks(data, json.loads(text)["checksum"]))


def signed_marks(data: bytes, checksum: int) -> bytes:
    """Marks as if they were of the store with a checksum."""
    fields = list(HEADER.unpack(data[: HEADER.size]))
    fields[OF_STORE] = checksum
    tables = TABLES + 12 * -(-fields[2 + min(fields[5], 2)] // 8)
    bricks = np.prod([-(-n // 8) for n in fields[2:5]], dtype=object)
    fields[OF_TABLES] = zlib.crc32(data[TABLES : tables + -(-bricks // 8)])
    head = HEADER.pack(*fields)
    return head + CRC.pack(zlib.crc32(head)) + data[TABLES:]


def sign_state(generation: Path, body: dict[str, Any]) -> None:
    """Write the header of a checkpoint's state, with the sizes and checksums of its files."""
    for name, file in body["files"].items():
        if (generation / name).is_file():
            data = (generation / name).read_bytes()
            file |= {"bytes": len(data), "crc32": zlib.crc32(data)}
    body.pop("checksum", None)
    body["checksum"] = zlib.crc32(json.dumps(body, sort_keys=True).encode())
    (generation / "state.json").write_text(json.dumps(body))
