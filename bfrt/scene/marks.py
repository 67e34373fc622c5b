"""Voxel marks on disk: made once for a store and a grid, used by every later render.

::

    offset  bytes  what
         0      8  magic
         8      4  format version
        12     12  voxels an axis: x, y, z
        24      4  checksum of the store's header
        28      4  CRC-32 of the marks
        32    ...  marks, one byte a voxel, x fastest
"""

from __future__ import annotations

import os
import struct
import zlib
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from bfrt.errors import ShortReadError, StoreError, StreamError
from bfrt.scene.store import Group, Store
from bfrt.streams.aside import aside, put

MAGIC = b"bfrtmark"
VERSION = 1
HEADER = struct.Struct("<8sI3III")

Shape = tuple[int, int, int]
Marks = NDArray[np.uint8]


def marks_path(store: Store, group: Group, scratch: Path) -> Path:
    """In the store, or in the scratch folder where the store is read-only."""
    home = store.path / str(group.number)
    if os.access(home if home.is_dir() else store.path, os.W_OK):
        return home / "marks"
    return scratch / f"{store.path.name}-{store.checksum:08x}-{group.number}.marks"


def save_marks(path: Path, store: Store, shape: Shape, marks: Marks) -> int:
    """Write marks aside and rename; returns the bytes written."""
    header = HEADER.pack(MAGIC, VERSION, *shape, store.checksum, zlib.crc32(marks))
    with aside(path) as temporary, temporary.open("wb", buffering=0) as file:
        put(file, header, path)
        put(file, memoryview(marks), path)
    return len(header) + marks.nbytes


def load_marks(path: Path, store: Store, shape: Shape, into: Marks) -> bool:
    """Read the marks of a grid of `shape` into an array; false where there are none of it.

    Raises
    ------
    StoreError
        If they are there but damaged.
    """
    try:
        with path.open("rb") as file:
            if not _matches(path, file.read(HEADER.size), store, shape):
                return False
            expected = _checksum(path)
            got = file.readinto(memoryview(into))
            more = file.read(1)
    except FileNotFoundError:
        return False
    except OSError as error:
        raise StreamError(path, 0, error.errno or 0, "reading") from error
    if got != into.nbytes:
        raise ShortReadError(path, HEADER.size, into.nbytes, got)
    if more or zlib.crc32(into) != expected:
        raise _damaged(path)
    return True


def verify_marks(store: Store, group: Group) -> None:
    """Check the marks in the store, if there are any."""
    path = store.path / str(group.number) / "marks"
    if not path.exists():
        return
    with path.open("rb") as file:
        header = file.read(HEADER.size)
    if len(header) < HEADER.size:
        raise _damaged(path)
    shape = HEADER.unpack(header)[2:5]
    if path.stat().st_size != HEADER.size + shape[0] * shape[1] * shape[2]:
        raise _damaged(path)
    into = np.empty(shape[0] * shape[1] * shape[2], np.uint8)
    if not load_marks(path, store, shape, into):
        raise _damaged(path)


def _matches(path: Path, header: bytes, store: Store, shape: Shape) -> bool:
    if len(header) < HEADER.size or header[:8] != MAGIC:
        raise _damaged(path)
    _, version, x, y, z, checksum, _ = HEADER.unpack(header)
    return version == VERSION and (x, y, z) == tuple(shape) and checksum == store.checksum


def _checksum(path: Path) -> int:
    with path.open("rb") as file:
        crc: int = HEADER.unpack(file.read(HEADER.size))[6]
    return crc


def _damaged(path: Path) -> StoreError:
    return StoreError(f"{path}: the marks are damaged: make them again with --fresh-marks")
