"""The layers of marks that are complete, in a checkpoint's folder while the others are made.

::

    bfrt-marks.GROUP.layers    coded bricks, layer after layer, as in the file of marks
    bfrt-marks.GROUP.index     what they are the marks of; then for each layer its checksums, its
                               bytes, and which bricks it has

Both only grow. A layer counts if its record is whole and its bytes have the checksum in it, so that
whatever ends the process, and whatever of the last writes the disk has got, the layers up to some
one are there.
"""

from __future__ import annotations

import io
import logging
import math
import os
import struct
import zlib
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from bfrt.checkpoint.checkpoint import EVERY, MARKS, MARKS_FILES
from bfrt.checkpoint.pace import Pace
from bfrt.checkpoint.state import BLOCK_BYTES
from bfrt.grid.marks_layout import CRC, Layout
from bfrt.refusals import calling, give_up
from bfrt.streams.atomic_write import put
from bfrt.streams.removal import remove_file

#: Of checkpoints, so that whoever hears where work goes on hears it of marks too.
log = logging.getLogger("bfrt.checkpoint.marks")

MAGIC = b"bfrtmlog"
LOG_VERSION = 1

#: Magic, version, shape, axis, what boxes are marked, the store's checksum.
HEAD = struct.Struct("<8sI3IIII")

#: Of a layer: the CRC-32 of its bricks, that of their coded bytes, and the number of these.
LAYER = struct.Struct("<IIq")

#: How files are opened that have to be files of ours.
FLAGS = os.O_RDWR | os.O_CREAT | os.O_CLOEXEC | getattr(os, "O_NOFOLLOW", 0)


class LoggedLayer(NamedTuple):
    """Describes a layer that is complete.

    Attributes
    ----------
    crc : int
        Of its bricks, as the file of marks has it.
    coded_crc, bytes : int
        Of its coded bytes.
    occupied : ndarray of uint8, shape (rows, bricks of a row)
        Which bricks are kept: 0 or 1.
    """

    crc: int
    coded_crc: int
    bytes: int
    occupied: NDArray[np.uint8]


class MarksLog:
    """Keeps the layers of one group's marks.

    Parameters
    ----------
    folder : Path
        The checkpoint's, which its owner has locked.
    group : int
        The group's number.
    """

    def __init__(self, folder: Path, group: int) -> None:
        self._paths = [folder / f"{MARKS}.{group}.{name}" for name in MARKS_FILES]
        self._files: list[io.FileIO] = []
        self._pace = Pace(EVERY)
        self._size = 0  # coded bytes of the layer that is added
        self._check = 0

    @property
    def is_there(self) -> bool:
        """Tell whether a run before has left one."""
        return any(os.path.lexists(path) for path in self._paths)

    def open(self, layout: Layout, checksum: int) -> list[LoggedLayer]:
        """Open the files to add to them; return the layers that are complete.

        Layers of another grid, or of other objects, are removed.

        Parameters
        ----------
        checksum : int
            The store's.
        """
        head = HEAD.pack(MAGIC, LOG_VERSION, *layout.shape, layout.axis, layout.boxes, checksum)
        head += CRC.pack(zlib.crc32(head))
        for path in self._paths:
            with calling(path, "opening"):
                self._files.append(io.FileIO(os.open(path, FLAGS, 0o600), "r+"))
        layers, index = self._files
        found = list(self._found(head, layout))
        with calling(self._paths[0], "cutting"):
            layers.truncate(sum(layer.bytes for layer in found))
            layers.seek(0, os.SEEK_END)
        with calling(self._paths[1], "cutting"):
            if not found:
                index.truncate(0)
            else:
                index.truncate(len(head) + len(found) * _record_bytes(layout))
            index.seek(0, os.SEEK_END)
        if not found:
            put(index, head, self._paths[1])
        else:
            told = "%s: goes on where it was left: marks, %d of %d layers are complete"
            log.info(told, self._paths[0].parent, len(found), layout.bricks[0])
        return found

    def _found(self, head: bytes, layout: Layout) -> Iterator[LoggedLayer]:
        """Yield the layers that are complete, up to the first that is not."""
        layers, index = self._files
        path, at = self._paths[0], 0
        with calling(self._paths[1], "reading"):
            records = io.BytesIO(index.readall())
        if records.read(len(head)) != head:
            return
        for _ in range(layout.bricks[0]):
            record = records.read(_record_bytes(layout))
            layer = _layer_of(record, layout)
            if layer is None:
                return
            check = 0
            for block in _blocks(layers, path, layer.bytes):
                check = zlib.crc32(block, check)
            with calling(path, "reading", at):
                at += layer.bytes
                if check != layer.coded_crc or layers.tell() != at:
                    return
            yield layer

    def coded(self, layer: LoggedLayer) -> Iterator[bytes]:
        """Yield the coded bytes of the next layer; the first call is for the first."""
        return _blocks(self._files[0], self._paths[0], layer.bytes)

    def rewind(self) -> None:
        """Have `coded` begin with the first layer."""
        with calling(self._paths[0], "seeking"):
            self._files[0].seek(0)

    def add(self, coded: memoryview) -> None:
        """Add coded bytes of the layer that is made."""
        put(self._files[0], coded, self._paths[0])
        self._size += len(coded)
        self._check = zlib.crc32(coded, self._check)

    def complete(self, crc: int, occupied: NDArray[np.uint8]) -> None:
        """Complete a layer, of whose bricks the checksum is given; sync it if that is due."""
        record = LAYER.pack(crc, self._check, self._size) + np.packbits(occupied).tobytes()
        put(self._files[1], record + CRC.pack(zlib.crc32(record)), self._paths[1])
        if self._pace.due(self._size):
            for file, path in zip(self._files, self._paths, strict=True):
                with calling(path, "syncing"):
                    os.fsync(file.fileno())
            self._pace = Pace(EVERY)
        self._size = self._check = 0

    def close(self) -> None:
        """Close the files, which stay."""
        for file in self._files:
            give_up(file)
        self._files.clear()

    def remove(self) -> None:
        """Remove the files: the marks are complete."""
        self.close()
        for path in self._paths:
            remove_file(path)


def _record_bytes(layout: Layout) -> int:
    return LAYER.size + -(-math.prod(layout.bricks[1:]) // 8) + CRC.size


def _layer_of(record: bytes, layout: Layout) -> LoggedLayer | None:
    """Return the layer that a record describes; None where it is not whole."""
    data, check = record[: -CRC.size], record[-CRC.size :]
    if len(record) < _record_bytes(layout) or CRC.unpack(check)[0] != zlib.crc32(data):
        return None
    crc, coded_crc, size = LAYER.unpack(data[: LAYER.size])
    if size < 0:
        return None
    bits = np.frombuffer(data, np.uint8, offset=LAYER.size)
    count = math.prod(layout.bricks[1:])
    occupied = np.unpackbits(bits, count=count).reshape(layout.bricks[1:])
    return LoggedLayer(crc, coded_crc, size, occupied)


def _blocks(file: io.FileIO, path: Path, size: int) -> Iterator[bytes]:
    """Yield the next bytes of a file, as far as there are some."""
    while size:
        with calling(path, "reading"):
            block = file.read(min(size, BLOCK_BYTES))
        if not block:
            return
        size -= len(block)
        yield block
