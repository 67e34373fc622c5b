"""E57: files of right checksums, whatever is in them, read by a process that is forked here."""

from __future__ import annotations

import struct
import subprocess
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import e57_files
from fuzz import hdf5
from fuzz.readers import CLOUD, convert
from fuzz.trial import Harness, of_bytes

from bfrt.formats.e57 import child
from bfrt.formats.remote import process as remote

#: Bytes of a page, of which the last are its checksum (CRC-32C, big endian).
PAGE, CHECKED = 1024, 1020
SIZE_AT = 16


def table() -> list[int]:
    entries = []
    for number in range(256):
        for _ in range(8):
            number = number >> 1 ^ (0x82F63B78 if number & 1 else 0)
        entries.append(number)
    return entries


TABLE = table()


def checksum(data: bytes) -> bytes:
    crc = 0xFFFFFFFF
    for byte in data:
        crc = TABLE[(crc ^ byte) & 255] ^ crc >> 8
    return (crc ^ 0xFFFFFFFF).to_bytes(4, "big")


def bare(file: bytes) -> bytes:
    """What is in a file's pages, without their checksums."""
    return b"".join(file[at : at + CHECKED] for at in range(0, len(file), PAGE))


def paged(data: bytes) -> bytes:
    """A file of these contents, whose size is as its header says."""
    pages = -(-len(data) // CHECKED)
    whole = bytearray(data.ljust(pages * CHECKED, b"\0"))
    if len(data) >= SIZE_AT + 8:
        struct.pack_into("<Q", whole, SIZE_AT, pages * PAGE)
    parts = (bytes(whole[k * CHECKED : (k + 1) * CHECKED]) for k in range(pages))
    return b"".join(part + checksum(part) for part in parts)


class Forked(hdf5.Forked):
    """Stands for `subprocess.Popen` of the process that reads."""

    @staticmethod
    def work(asked: list[str]) -> Any:
        return lambda: child.main(*remote.json.loads(asked[3]))


def e57(home: Path) -> Harness:
    seeds = []
    for spherical, invalid in ((False, True), (True, False)):
        path = home / f"{spherical}.e57"
        made = e57_files.scan(12, 1, spherical=spherical, invalid=invalid)
        e57_files.write(path, [made, made], [((1, 0, 0, 1), (1, 2, 3))])
        seeds.append(bare(path.read_bytes()))

    def run(data: bytes, folder: Path) -> None:
        (folder / "in" / "a.e57").write_bytes(paged(data))
        kept = remote.subprocess
        remote.subprocess = SimpleNamespace(
            Popen=Forked, PIPE=subprocess.PIPE, DEVNULL=subprocess.DEVNULL
        )
        try:
            convert(data, folder, "a.e57", (*CLOUD[:3], CLOUD[4]))
        finally:
            remote.subprocess = kept

    tokens = (b"ASTM-E57", b"cartesianX", b"recordCount=", b"Integer", b'minimum="0"', b"\1\0\0")
    return of_bytes(seeds, tokens, run)
