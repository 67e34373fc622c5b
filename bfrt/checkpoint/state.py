"""One generation of a checkpoint: files of records, and a header with their checksums."""

from __future__ import annotations

import json
import os
import zlib
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bfrt.checkpoint.soundness import HEADER_FACTS, Sound, check_facts
from bfrt.errors import CheckpointError
from bfrt.paths import facts_at
from bfrt.refusals import refused
from bfrt.store.file_facts import checksum_of
from bfrt.streams.atomic_write import sync_folder
from bfrt.streams.writer import view_of, write_all

HEADER = "state.json"
MAGIC = "bfrt checkpoint"
FORMAT = 2

#: Bytes that are written, and read, at once.
BLOCK_BYTES = 1 << 20

Facts = dict[str, Any]


class StateWriter:
    """Writes a state into a folder that is there and empty.

    Attributes
    ----------
    bytes : int
        Bytes written so far.
    """

    def __init__(self, folder: Path) -> None:
        self.bytes = 0
        self._folder = folder
        self._files: dict[str, Facts] = {}

    def put(self, name: str, blocks: Iterable[NDArray[Any]]) -> None:
        """Write arrays (C-contiguous), one after another, to a new file, and sync it."""
        path = self._folder / name
        size = check = 0
        fd = _create(path)
        try:
            for block in blocks:
                view = view_of(block)
                for first in range(0, len(view), BLOCK_BYTES):
                    some = view[first : first + BLOCK_BYTES]
                    check = zlib.crc32(some, check)
                    size += write_all(fd, some, path, size)
            _sync(fd, path, size)
        finally:
            os.close(fd)
        self.bytes += size
        self._files[name] = {"bytes": size, "crc32": check}

    def complete(self, identity: Facts, facts: Facts) -> None:
        """Write the header, which makes it a state, and sync the folder."""
        body: Facts = {
            "magic": MAGIC,
            "format": FORMAT,
            "identity": identity,
            "facts": facts,
            "files": self._files,
        }
        body["checksum"] = _checksum(body)
        path = self._folder / HEADER
        fd = _create(path)
        try:
            data = json.dumps(body, indent=1).encode()
            _sync(fd, path, write_all(fd, data, path, 0))
        finally:
            os.close(fd)
        sync_folder(self._folder)


class SavedState:
    """Reads a complete state.

    Parameters
    ----------
    folder : Path
        The generation.

    Attributes
    ----------
    identity : dict
        What it is the state of.
    facts : dict
        The numbers of it.
    sound : Sound, optional
        Checks the records that are read.

    Raises
    ------
    CheckpointError
        If it is damaged or of another format; every byte is read.
    StreamError
        If the system refuses to read it.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        body = _header_of(folder / HEADER)
        self.identity: Facts = body["identity"]
        self.facts: Facts = body["facts"]
        self.sound: Sound | None = None
        self._files: dict[str, Facts] = body["files"]
        for name, file in self._files.items():
            check_file(folder / name, file)

    @property
    def bytes(self) -> int:
        """Return the bytes of its files."""
        return sum(int(file["bytes"]) for file in self._files.values())

    def __contains__(self, name: str) -> bool:
        return name in self._files

    def count(self, name: str, dtype: np.dtype[Any]) -> int:
        """Return the number of records that a file has.

        Raises
        ------
        CheckpointError
            If its bytes are not those of whole records, or there is no such file.
        """
        size = self._files[name]["bytes"] if name in self._files else -1
        if size % dtype.itemsize or size < 0:
            raise CheckpointError(
                f"{self.folder / name}: found {max(size, 0)} bytes, expected whole records of "
                f"{dtype.itemsize} bytes"
            )
        return int(size // dtype.itemsize)

    def blocks(self, name: str, dtype: np.dtype[Any]) -> Iterator[NDArray[Any]]:
        """Yield the records of a file, some at a time."""
        left = self.count(name, dtype)
        path = self.folder / name
        try:
            with path.open("rb", buffering=0) as file:
                while left:
                    block = np.empty(min(left, BLOCK_BYTES // dtype.itemsize), dtype)
                    self._read_into(block, file, path)
                    left -= len(block)
                    yield block
        except OSError as error:
            raise refused(path, 0, error, "reading") from error

    def fill(self, name: str, array: NDArray[Any]) -> None:
        """Read a file into an array (C-contiguous) of its size."""
        path = self.folder / name
        if self.count(name, np.dtype(np.uint8)) != array.nbytes:
            size = self._files[name]["bytes"]
            raise CheckpointError(f"{path}: found {size} bytes, expected {array.nbytes}")
        try:
            with path.open("rb", buffering=0) as file:
                self._read_into(array, file, path)
        except OSError as error:
            raise refused(path, 0, error, "reading") from error

    def _read_into(self, array: NDArray[Any], file: Any, path: Path) -> None:
        view = view_of(array)
        while len(view):
            got = file.readinto(view)
            if not got:
                raise CheckpointError(f"{path}: found it to end early: it has changed since")
            view = view[got:]
        if self.sound is not None and array.dtype.names:
            self.sound.check(path, array)


def _header_of(path: Path) -> Facts:
    try:
        body = json.loads(path.read_bytes())
    except FileNotFoundError:
        raise CheckpointError(f"{path}: the header is missing: expected a state of bfrt") from None
    except OSError as error:
        raise refused(path, 0, error, "reading") from error
    except (ValueError, RecursionError):
        raise CheckpointError(f"{path}: found damage, expected a checkpoint's header") from None
    if not isinstance(body, dict) or body.get("magic") != MAGIC:
        raise CheckpointError(f"{path}: found no checkpoint's header, expected {MAGIC!r}")
    if body.get("format") != FORMAT:
        found = str(body.get("format"))
        raise CheckpointError(f"{path}: found format {found:.20}, expected {FORMAT}")
    if body.pop("checksum", None) != _checksum(body):
        raise CheckpointError(f"{path}: found damage, expected what its checksum says")
    check_facts(path, body, HEADER_FACTS)
    return body


def _checksum(body: Facts) -> int:
    return zlib.crc32(json.dumps(body, sort_keys=True).encode())


def check_file(path: Path, file: Facts) -> None:
    """Refuse a file that differs from what was written."""
    there = facts_at(path)
    found = "no file" if there is None else f"{there.st_size} bytes"
    if there is None or there.st_size != file["bytes"]:
        raise CheckpointError(
            f"{path}: found {found}, expected {file['bytes']} bytes: the checkpoint is truncated"
        )
    check, size = checksum_of(path)
    if (check, size) != (file["crc32"], file["bytes"]):
        raise CheckpointError(
            f"{path}: the contents differ from what was written: expected {file['bytes']} bytes "
            f"with CRC-32 {file['crc32']:08x}"
        )


def _create(path: Path) -> int:
    try:
        return os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600)
    except OSError as error:
        raise refused(path, 0, error, "creating") from error


def _sync(fd: int, path: Path, size: int) -> None:
    try:
        os.fsync(fd)
    except OSError as error:
        raise refused(path, size, error, "syncing") from error
