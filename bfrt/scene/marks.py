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

import math
import os
import struct
import zlib
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from bfrt.errors import StoreError
from bfrt.scene.store import Group, Store, checksum_of
from bfrt.streams.aside import aside, put, refused

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
    header = HEADER.pack(MAGIC, VERSION, *shape, store.checksum, zlib.crc32(marks.data))
    with aside(path) as temporary, temporary.open("wb", buffering=0) as file:
        put(file, header, path)
        put(file, marks.data, path)
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
            header = _header(path, file.read(HEADER.size))
            if not _is_of(header, store, shape):
                return False
            got = file.readinto(into.data)
            more = file.read(1)
    except FileNotFoundError:
        return False
    except OSError as error:
        raise refused(path, 0, error, "reading") from error
    if got != into.nbytes or more or zlib.crc32(into.data) != header.crc32:
        raise _damaged(path)
    return True


def verify_marks(store: Store, group: Group) -> None:
    """Check the marks in the store, if there are any."""
    path = store.path / str(group.number) / "marks"
    try:
        with path.open("rb") as file:
            header = _header(path, file.read(HEADER.size))
    except FileNotFoundError:
        return
    except OSError as error:
        raise refused(path, 0, error, "reading") from error
    whole = checksum_of(path, HEADER.size) == (header.crc32, math.prod(header.shape))
    if not (whole and _is_of(header, store, header.shape)):
        raise _damaged(path)


class Header(NamedTuple):
    """What stands before the marks."""

    version: int
    shape: Shape
    store: int
    crc32: int


def _header(path: Path, data: bytes) -> Header:
    if len(data) < HEADER.size or data[: len(MAGIC)] != MAGIC:
        raise _damaged(path)
    _, version, x, y, z, store, crc = HEADER.unpack(data)
    return Header(version, (x, y, z), store, crc)


def _is_of(header: Header, store: Store, shape: Shape) -> bool:
    return header[:3] == (VERSION, tuple(shape), store.checksum)


def _damaged(path: Path) -> StoreError:
    return StoreError(f"{path}: the marks are damaged: make them again with --fresh-marks")
