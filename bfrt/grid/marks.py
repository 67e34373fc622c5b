"""Voxel marks on disk: made once for a store and a grid, used by every later render.

Marks are kept by bricks of 8 x 8 x 8 voxels, of which those without any mark are left out, each
coded by its commonest mark (bfrt/grid/_coding.pyx): a quarter of the bytes or less, for a slab is
read in every pass of a scene whose grid memory does not hold. The bricks of a layer lie together::

    offset  bytes      what
         0      8      magic
         8      4      format version
        12     12      voxels an axis: x, y, z
        24      4      the axis across the layers: 0, 1, 2
        28      4      checksum of the store's header
        32      8      bricks that are kept
        40      4      of which boxes they are: 0, or a checksum of quantised ones
        44      4      CRC-32 of the tables
        48      4      CRC-32 of these 48 bytes
        52      4 L    the CRC-32 of each layer's bricks, one byte a voxel
       ...      8 L    bytes that they take as they are coded
       ...      B / 8  a bit for each brick, the first in the highest: whether it is kept
       ...             the bricks, coded

Bricks, and voxels in a brick, come in the order of their numbers (bfrt/grid/planes.pxd); a brick
at the border of the grid is whole, and its voxels beyond have no marks. Bits 0 to 5 of a voxel are
its marks, bit 6 is set where its cube of 4 voxels a side has none.
"""

from __future__ import annotations

import errno
import io
import math
import os
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from bfrt.errors import ShortReadError, StoreError, StreamError
from bfrt.grid._coding import MOST_CODED, decode, encode
from bfrt.grid.bricks import BRICK_BYTES
from bfrt.grid.marks_home import is_believed, is_inside, prepare_home
from bfrt.grid.marks_layout import CRC, HEADER, LAYER_BYTES, Layout
from bfrt.grid.marks_log import MarksLog
from bfrt.refusals import calling, refused
from bfrt.store.store import Group, Store
from bfrt.streams.atomic_write import atomic_own_file, put
from bfrt.streams.ownership import is_named
from bfrt.streams.reader import Reader, SharedFile

MAGIC = b"bfrtmark"
MARKS_VERSION = 5

#: Bytes of the buffer through which a thread reads a layer.
MARKS_BUFFER = 1 << 16

#: Bricks that are coded before they are written.
CODED = 1024

Bytes = NDArray[np.uint8]


class Marks:
    """Gives access to the marks of a file, of which only the tables are in memory.

    The file stays open, so that it does not matter if another render replaces it meanwhile.

    Attributes
    ----------
    occupied : ndarray of uint8, shape (layers, rows, bricks of a row)
        Which bricks are kept: 0 or 1.
    first : ndarray of int64, shape (layers + 1,)
        Number of bricks before each layer.
    at : ndarray of int64, shape (layers + 1,)
        Where each layer begins in the file, and the last ends.
    """

    def __init__(
        self,
        path: Path,
        layout: Layout,
        occupied: Bytes,
        crcs: NDArray[np.uint32],
        sizes: NDArray[np.int64],
        file: SharedFile,
    ) -> None:
        self.path = path
        self.layout = layout
        self.occupied = occupied
        self.first = np.zeros(len(occupied) + 1, np.int64)
        np.cumsum(occupied.sum(axis=(1, 2)), out=self.first[1:])
        self.at = np.full(len(sizes) + 1, layout.data_at, np.int64)
        self.at[1:] += np.cumsum(sizes)
        self._crcs = crcs
        self._checked = np.zeros(len(crcs), np.bool_)
        self._file = file

    def read(self, number: int, bricks: Bytes) -> None:
        """Read the bricks (n, 512) that are kept of a layer; threads may read at once.

        Raises
        ------
        StoreError
            If they are damaged: when they are read for the first time.
        """
        reader = Reader(self._file, MARKS_BUFFER)
        reader.window(int(self.at[number]), int(self.at[number + 1]))
        try:
            decode(reader, bricks)
        except ShortReadError:
            raise _damaged(self.path) from None
        except StreamError as error:
            raise refused(self.path, error.offset, OSError(error.errno, ""), "reading") from None
        if not self._checked[number] and zlib.crc32(bricks.data) != self._crcs[number]:
            raise _damaged(self.path)
        self._checked[number] = True

    def close(self) -> None:
        del self._file


class MarksWriter:
    """Writes the bricks of a grid, layer by layer.

    Attributes
    ----------
    marks : Marks
        The marks written, when all layers are.
    layers : int
        Number of layers of bricks that are written.
    log : MarksLog, optional
        Gets the layers too.
    """

    def __init__(self, file: io.FileIO, path: Path, layout: Layout) -> None:
        self.log: MarksLog | None = None
        self.occupied = np.zeros(layout.bricks, np.uint8)
        self.crcs = np.zeros(layout.bricks[0], np.uint32)
        self.sizes = np.zeros(layout.bricks[0], np.int64)
        self.bytes = layout.data_at
        self.marks: Marks
        self._file, self._path = file, path
        self.layers = 0
        self._coded = np.empty(CODED * MOST_CODED, np.uint8)
        self._go(layout.data_at)

    def _go(self, at: int) -> None:
        with calling(self._path, "seeking", at):
            self._file.seek(at)

    def add(self, bricks: Bytes, occupied: Bytes) -> None:
        """Add the next layer: its bricks (n, 512), and which are kept, (rows, bricks of a row)."""
        crc = zlib.crc32(bricks.data) if len(bricks) else 0
        for first in range(0, len(bricks), CODED):
            size = encode(bricks[first : first + CODED], self._coded)
            self._put(self._coded[:size].data)
            if self.log is not None:
                self.log.add(self._coded[:size].data)
        if self.log is not None:
            self.log.complete(crc, occupied)
        self._complete(crc, occupied)

    def take(self, log: MarksLog, store: Store, layout: Layout) -> None:
        """Take the layers that a log has; it gets the others."""
        found = log.open(layout, store.checksum)
        log.rewind()
        for layer in found:
            for block in log.coded(layer):
                self._put(memoryview(block))
            self._complete(layer.crc, layer.occupied)
        self.log = log

    def _put(self, coded: memoryview) -> None:
        put(self._file, coded, self._path)
        self.sizes[self.layers] += len(coded)

    def _complete(self, crc: int, occupied: Bytes) -> None:
        """Complete a layer, whose coded bricks are written."""
        self.crcs[self.layers] = crc
        self.occupied[self.layers] = occupied
        self.bytes += int(self.sizes[self.layers])
        self.layers += 1


@contextmanager
def writing_marks(path: Path, store: Store, layout: Layout) -> Iterator[MarksWriter]:
    """Yield a writer of marks, whose file takes its name when all layers are written."""
    prepare_home(path, store)
    mode = 0o666 if is_inside(path, store) else 0o600
    with atomic_own_file(path, mode) as file:
        writer = MarksWriter(file, path, layout)
        yield writer
        kept = int(writer.occupied.sum())
        tables = writer.crcs.astype("<u4").tobytes() + writer.sizes.astype("<i8").tobytes()
        tables += np.packbits(writer.occupied).tobytes()
        header = HEADER.pack(
            MAGIC, MARKS_VERSION, *layout.shape, layout.axis, store.checksum, kept, layout.boxes,
            zlib.crc32(tables),
        )  # fmt: skip
        writer._go(0)
        put(file, header + CRC.pack(zlib.crc32(header)) + tables, path)
        made = writer.occupied, writer.crcs, writer.sizes
        writer.marks = Marks(path, layout, *made, SharedFile(Path(file.name)))


def open_marks(path: Path, store: Store, layout: Layout) -> Marks | None:
    """Open the marks of this layout; None where there are none that are believed.

    Raises
    ------
    StoreError
        If they are there but damaged, as far as the tables and the size show.
    """
    file = _opened(path, store)
    if file is None:
        return None
    found = _read_tables(path, file, verified=False)
    if found is None or found[:2] != (layout, store.checksum):
        return None
    return Marks(path, layout, *found[2:], file)


def verify_marks(store: Store, group: Group) -> None:
    """Check the marks in the store, if there are any."""
    path = store.marks_of(group)
    file = _opened(path, store)
    if file is None:
        return
    found = _read_tables(path, file, verified=True)
    if found is None or found[1] != store.checksum:
        raise _damaged(path)
    marks = Marks(path, found[0], *found[2:], file)
    try:
        for number, n in enumerate(np.diff(marks.first).tolist()):
            marks.read(number, np.empty((n, BRICK_BYTES), np.uint8))
    finally:
        marks.close()


def _opened(path: Path, store: Store) -> SharedFile | None:
    """Open the file of marks, if there are some that are believed: once, for tables and bricks."""
    if not is_believed(path, store):
        return None
    try:
        file = SharedFile(path)
    except StreamError as error:
        if error.errno == errno.ENOENT:
            return None
        raise refused(path, 0, OSError(error.errno, ""), "reading") from None
    return file if is_named(file.fileno(), path) else None


def _read_tables(
    path: Path, opened: SharedFile, *, verified: bool
) -> tuple[Layout, int, Bytes, NDArray[np.uint32], NDArray[np.int64]] | None:
    """Return a file's layout, the store's checksum, and the occupied bricks, checksums and sizes of
    layers; None where the file is of another version, unless `verified`, which refuses it.
    """
    try:
        with os.fdopen(os.dup(opened.fileno()), "rb") as file:
            size = os.fstat(file.fileno()).st_size
            file.seek(0)
            header = file.read(HEADER.size)
            check = file.read(CRC.size)
            if len(check) < CRC.size or header[: len(MAGIC)] != MAGIC:
                raise _damaged(path)
            _, version, x, y, z, axis, checksum, kept, boxes, tables_crc = HEADER.unpack(header)
            if version != MARKS_VERSION and not verified:
                return None
            if CRC.unpack(check)[0] != zlib.crc32(header):
                raise _damaged(path)
            if version != MARKS_VERSION:
                raise StoreError(
                    f"{path}: found marks of version {version}, expected {MARKS_VERSION}: the next "
                    "render makes them again"
                )
            layout = Layout((x, y, z), axis, boxes)
            if axis > 2 or 0 in layout.shape or size < layout.data_at:
                raise _damaged(path)
            tables = file.read(layout.data_at - file.tell())
    except OSError as error:
        raise refused(path, 0, error, "reading") from error
    if zlib.crc32(tables) != tables_crc:
        raise _damaged(path)
    layers = layout.bricks[0]
    crcs = np.frombuffer(tables, "<u4", layers).astype(np.uint32)
    sizes = np.frombuffer(tables, "<i8", layers, CRC.size * layers).astype(np.int64)
    bits = np.frombuffer(tables, np.uint8, offset=LAYER_BYTES * layers)
    total = math.prod(layout.bricks)
    occupied = np.unpackbits(bits, count=total).reshape(layout.bricks)
    if int(occupied.sum()) != kept or size != layout.data_at + int(sizes.sum()):
        raise _damaged(path)
    return layout, checksum, occupied, crcs, sizes


def _damaged(path: Path) -> StoreError:
    return StoreError(f"{path}: the marks are damaged: make them again with --fresh-marks")
