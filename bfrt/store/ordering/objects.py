"""Objects of one kind on their way into order: records, materials and ids, in arrays."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from bfrt.records import Kind
from bfrt.refusals import buffer_of
from bfrt.store._bounds import bound
from bfrt.store.model import Vector
from bfrt.store.ordering._loops import gather, gather_runs

Bytes = NDArray[np.uint8]


#: Objects that are read at once.
OBJECTS_AT_ONCE = 1 << 16

#: Vertices of polygons that are read at once, unless one polygon has more.
VERTICES_AT_ONCE = 1 << 18

#: Bytes of an array from which on its memory is the system's again as soon as it is let go; the
#: allocator keeps that of some arrays, for others.
OWN_MEMORY = 1 << 20

#: Ids below this take four bytes each, others eight.
SHORT_IDS = 1 << 32


def id_bytes_of(count: int) -> int:
    """Return the bytes of an id where there are `count` objects."""
    return 4 if count <= SHORT_IDS else 8


class Layout(NamedTuple):
    """Says what a stream's records are.

    Attributes
    ----------
    kind : Kind
    wide : bool
        Whether coordinates are float64.
    origin : tuple of 3 float
        The store's.
    id_bytes : int
        Bytes of an object's id on disk, 4 or 8.
    material_bytes : int
        Bytes of its material, 1, 2 or 4; 0 where all have one.
    material : int
        The material that all have then.
    """

    kind: Kind
    wide: bool
    origin: Vector
    id_bytes: int = 8
    material_bytes: int = 4
    material: int = 0

    @property
    def stride(self) -> int:
        """Return the bytes of a record; for polygons, of a vertex."""
        return self.kind.scalars * (8 if self.wide else 4)

    def materials(self, count: int, stored: Bytes | None) -> NDArray[np.uint32]:
        """Return the materials of some objects, as they are stored or, if they are not, all one."""
        if stored is None:
            return np.full(count, self.material, np.uint32)
        return stored.view(f"<u{self.material_bytes}").astype(np.uint32)


class Objects(NamedTuple):
    """Holds some objects.

    Attributes
    ----------
    geometry : ndarray of uint8
        Their records; of polygons their vertices.
    counts : (n,) uint32
        Vertices of each polygon; of other kinds empty.
    materials : (n,) uint32
    ids : (n,) uint64
        Their places in the order given.
    """

    geometry: Bytes
    counts: NDArray[np.uint32]
    materials: NDArray[np.uint32]
    ids: NDArray[np.uint64]

    @property
    def number(self) -> int:
        """Return the number of objects."""
        return len(self.materials)

    def boxes(self, layout: Layout) -> NDArray[np.float32]:
        """Compute their boxes, (n, 6), as the writer does."""
        scalar = np.float64 if layout.wide else np.float32
        records = self.geometry.view(scalar).reshape(-1, layout.kind.scalars)
        boxes = np.empty((self.number, 6), np.float32)
        counts = self.counts if layout.kind.counted else self.materials
        bound(layout.kind, records, counts, layout.origin, boxes)
        return boxes

    def taken(self, order: NDArray[np.uint32], layout: Layout) -> Objects:
        """Return some of them, in an order."""
        materials, ids = self.materials[order], self.ids[order]
        if layout.kind.counted:
            counts = self.counts[order]
            geometry = bytes_for(int(counts.sum(dtype=np.int64)) * layout.stride)
            ends = np.cumsum(self.counts, dtype=np.int64)
            gather_runs(self.geometry, layout.stride, ends, order, geometry)
            return Objects(geometry, counts, materials, ids)
        geometry = bytes_for(len(order) * layout.stride)
        gather(self.geometry, layout.stride, order, geometry)
        return Objects(geometry, self.counts, materials, ids)

    def between(self, first: int, last: int, layout: Layout) -> Objects:
        """Return the objects [first, last): views."""
        if layout.kind.counted:
            begin = int(self.counts[:first].sum(dtype=np.int64))
            end = begin + int(self.counts[first:last].sum(dtype=np.int64))
            counts = self.counts[first:last]
        else:
            begin, end, counts = first, last, self.counts
        geometry = self.geometry[begin * layout.stride : end * layout.stride]
        return Objects(geometry, counts, self.materials[first:last], self.ids[first:last])


def few_at_once(counts: NDArray[np.uint32]) -> int:
    """Return how many of the next polygons, one or more, are read at once."""
    ends = np.cumsum(counts, dtype=np.int64)
    return max(1, int(np.searchsorted(ends, VERTICES_AT_ONCE, "right")))


def bytes_for(size: int) -> Bytes:
    """Return memory of `size` bytes that takes room as it fills, and none when it is let go."""
    if size < OWN_MEMORY:
        return np.empty(size, np.uint8)
    return np.frombuffer(buffer_of(size), np.uint8)


class Filling:
    """Takes objects one after another into arrays that have room for all of them.

    Parameters
    ----------
    layout : Layout
    objects, records : int
        The most objects that come, and records: objects again, or vertices of polygons.
    """

    def __init__(self, layout: Layout, objects: int, records: int) -> None:
        self._layout = layout
        self._objects = self._records = 0
        counted = objects if layout.kind.counted else 0
        self._held = Objects(
            bytes_for(records * layout.stride),
            bytes_for(counted * 4).view(np.uint32),
            bytes_for(objects * 4).view(np.uint32),
            bytes_for(objects * 8).view(np.uint64),
        )

    def add(self, some: Objects) -> None:
        """Copy some objects behind the others."""
        held, n, stride = self._held, self._objects, self._layout.stride
        begin, size = self._records * stride, len(some.geometry)
        held.geometry[begin : begin + size] = some.geometry
        if self._layout.kind.counted:
            held.counts[n : n + some.number] = some.counts
        held.materials[n : n + some.number] = some.materials
        held.ids[n : n + some.number] = some.ids
        self._objects += some.number
        self._records += size // stride

    def taken(self) -> Objects:
        """Return all objects, views."""
        return self._held.between(0, self._objects, self._layout)
