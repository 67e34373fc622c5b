"""A file without a name, in regions: each holds the objects of a part, column by column."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bfrt.errors import ShortReadError
from bfrt.records import Kind
from bfrt.store.ordering.objects import OBJECTS_AT_ONCE, Layout, Objects
from bfrt.streams.atomic_write import nameless, refused
from bfrt.streams.free import check_free
from bfrt.streams.writer import view_of

Sizes = NDArray[np.int64]

#: Bytes of an object beside its geometry: its vertices' number, for polygons; material; id.
COUNT_BYTES, MATERIAL_BYTES, ID_BYTES = 4, 4, 8


def object_bytes(kind: Kind, count: int) -> int:
    """Return the bytes of one of `count` objects beside its geometry."""
    return (COUNT_BYTES if kind.counted else 0) + MATERIAL_BYTES + ID_BYTES


class Regions:
    """Takes objects into regions, and gives those of a region back in the order they came.

    Parameters
    ----------
    layout : Layout
    objects : (regions,) int64
        Objects of each region.
    records : (regions,) int64
        Records of each: objects, or vertices of polygons.
    scratch : Path
        Folder of the file.

    Attributes
    ----------
    objects
        As given.
    bytes : int
        Of all regions.
    """

    def __init__(self, layout: Layout, objects: Sizes, records: Sizes, scratch: Path) -> None:
        self._layout = layout
        self.objects = objects
        self._path = scratch / "parts"
        counted = COUNT_BYTES if layout.kind.counted else 0
        sizes = np.stack(
            [records * layout.stride, objects * counted, objects * MATERIAL_BYTES,
             objects * ID_BYTES], 1,
        )  # fmt: skip
        ends = np.cumsum(sizes).reshape(sizes.shape)
        self._begins = ends - sizes
        self._at = self._begins.copy()
        self.bytes = int(sizes.sum())
        check_free(scratch, self.bytes, "parting objects with")
        self._file = nameless(scratch, self._path)

    def append(self, region: int, some: Objects) -> None:
        """Add objects to a region."""
        at = self._at[region]
        columns: list[NDArray[Any]] = [some.geometry, some.counts, some.materials, some.ids]
        for k, column in enumerate(columns):
            data = view_of(column)
            done = 0
            while done < len(data):
                try:
                    done += os.pwrite(self._file.fileno(), data[done:], int(at[k]) + done)
                except OSError as error:
                    raise refused(self._path, int(at[k]) + done, error, "writing") from error
            at[k] += done

    def reader(self, region: int) -> Callable[[], Iterator[Objects]]:
        """Return what gives the objects of a region, block by block, as often as it is called."""

        def blocks() -> Iterator[Objects]:
            at = self._begins[region].copy()
            left = int(self._at[region, 2] - at[2]) // MATERIAL_BYTES
            while left:
                n = min(left, OBJECTS_AT_ONCE)
                counts = np.empty(0, np.uint32)
                records = n
                if self._layout.kind.counted:
                    counts = self._read(at, 1, n * COUNT_BYTES).view(np.uint32)
                    records = int(counts.sum(dtype=np.int64))
                yield Objects(
                    self._read(at, 0, records * self._layout.stride),
                    counts,
                    self._read(at, 2, n * MATERIAL_BYTES).view(np.uint32),
                    self._read(at, 3, n * ID_BYTES).view(np.uint64),
                )
                left -= n

        return blocks

    def _read(self, at: Sizes, column: int, size: int) -> NDArray[np.uint8]:
        """Return the next bytes of a column, and go forward there."""
        begin = int(at[column])
        made = np.empty(size, np.uint8)
        done = 0
        while done < size:
            try:
                got = os.preadv(self._file.fileno(), [made[done:].data], begin + done)
            except OSError as error:
                raise refused(self._path, begin + done, error, "reading") from error
            if not got:
                raise ShortReadError(self._path, begin + done, size - done, 0)
            done += got
        at[column] += size
        return made

    def close(self) -> None:
        """Give the disk back."""
        self._file.close()
