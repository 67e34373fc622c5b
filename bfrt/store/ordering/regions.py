"""A file without a name, in regions: each holds the objects of a part, column by column."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bfrt.errors import ShortReadError
from bfrt.refusals import give_up, refused
from bfrt.store.ordering.objects import OBJECTS_AT_ONCE, Layout, Objects, bytes_for, few_at_once
from bfrt.streams.atomic_write import nameless
from bfrt.streams.free import check_free
from bfrt.streams.writer import view_of

Sizes = NDArray[np.int64]

NO_BYTES = np.empty(0, np.uint8)

#: Bytes of the number of a polygon's vertices.
COUNT_BYTES = 4


def object_bytes(layout: Layout) -> int:
    """Return the bytes of an object beside its geometry: vertices' number, material, id."""
    return sum(_widths(layout))


def _widths(layout: Layout) -> tuple[int, int, int]:
    counted = COUNT_BYTES if layout.kind.counted else 0
    return counted, layout.material_bytes, layout.id_bytes


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
        columns = [records * layout.stride, *(objects * width for width in _widths(layout))]
        sizes = np.stack(columns, 1)
        ends = np.cumsum(sizes).reshape(sizes.shape)
        self._begins = ends - sizes
        self._at = self._begins.copy()
        self.bytes = int(sizes.sum())
        check_free(scratch, self.bytes, "parting objects with")
        self._file = nameless(scratch, self._path)

    def append(self, region: int, some: Objects) -> None:
        """Add objects to a region."""
        at = self._at[region]
        layout = self._layout
        columns: list[NDArray[Any]] = [some.geometry, some.counts]
        if layout.material_bytes:
            columns.append(some.materials.astype(f"<u{layout.material_bytes}", copy=False))
        else:
            columns.append(NO_BYTES)
        columns.append(some.ids.astype(f"<u{layout.id_bytes}", copy=False))
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
            layout = self._layout
            left = int(self._at[region, 3] - at[3]) // layout.id_bytes
            ahead = np.empty(0, np.uint32)  # the counts of polygons that come next
            while left:
                records = n = min(left, OBJECTS_AT_ONCE)
                if layout.kind.counted:
                    if not len(ahead):
                        ahead = self._read(at, 1, n * COUNT_BYTES).view(np.uint32)
                    n = few_at_once(ahead)
                    counts, ahead = ahead[:n], ahead[n:]
                    records = int(counts.sum(dtype=np.int64))
                else:
                    counts = ahead
                geometry = self._read(at, 0, records * layout.stride)
                materials = None
                if layout.material_bytes:
                    materials = self._read(at, 2, n * layout.material_bytes)
                ids = self._read(at, 3, n * layout.id_bytes).view(f"<u{layout.id_bytes}")
                yield Objects(
                    geometry, counts, layout.materials(n, materials), ids.astype(np.uint64)
                )
                left -= n

        return blocks

    def _read(self, at: Sizes, column: int, size: int) -> NDArray[np.uint8]:
        """Return the next bytes of a column, and go forward there."""
        begin = int(at[column])
        made = bytes_for(size)
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
        give_up(self._file)
