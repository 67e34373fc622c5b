"""A stream's files as they grow: blocks of one kind's objects in, a column a file out.

A block is prepared first, which any thread may do, and then added, in the order of the objects.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from bfrt.errors import SceneError, ShortReadError
from bfrt.ids import object_id, stream_number
from bfrt.records import BOX_BYTES, SCALARS, Kind
from bfrt.refusals import refused
from bfrt.store._bounds import bound
from bfrt.store.extent import Extent
from bfrt.store.header import facts_of
from bfrt.store.hierarchy import Boxes, Hierarchy, HierarchyWriter, Level
from bfrt.store.locality import Locality
from bfrt.store.material_column import READ_BACK_AT_ONCE, MaterialColumn
from bfrt.store.model import Vector
from bfrt.store.ordering.given import GivenFiles
from bfrt.store.ordering.objects import Layout, id_bytes_of
from bfrt.streams.writer import FileWriter
from bfrt.workers import ahead, usable_threads


class Prepared(NamedTuple):
    """Holds objects of one kind as they go to disk, in arrays that nobody else has.

    Attributes
    ----------
    geometry : ndarray of uint8
        Their records.
    counts : (n,) uint32
        Number of vertices of each polygon; not used for other kinds.
    materials : (n,) uint32
    boxes : (n, 6) float32
    degenerate : int
        Number of objects that nothing can hit.
    bad : int
        The first that is not finite, or -1.
    group : int
        Number of the group that they belong to.
    """

    kind: Kind
    wide: bool
    geometry: NDArray[np.uint8]
    counts: NDArray[np.uint32]
    materials: NDArray[np.uint32]
    boxes: NDArray[np.float32]
    degenerate: int
    bad: int
    group: int


def prepare(
    kind: Kind,
    records: NDArray[Any],
    counts: NDArray[np.uint32],
    materials: NDArray[np.uint32],
    origin: Vector,
    group: int = 0,
) -> Prepared:
    """Work out the boxes of records (n, scalars), or of vertices (m, 3) of n polygons.

    The records, C-contiguous, are kept as they are: nobody may change them any more.
    """
    wide = records.dtype == np.float64
    boxes = np.empty((len(materials), 6), np.float32)
    degenerate, bad = bound(kind, records, counts, origin, boxes)
    flat = records.reshape(-1).view(np.uint8)
    return Prepared(kind, wide, flat, counts, materials, boxes, degenerate, bad, group)


class StreamWriter:
    """Writes the files of one kind."""

    def __init__(self, folder: Path, group: int, kind: Kind, wide: bool, durable: bool) -> None:
        try:
            folder.mkdir(parents=True)
        except OSError as error:
            raise refused(folder, 0, error, "creating") from error
        self.group = group
        self.kind = kind
        self._folder = folder
        self._durable = durable
        self.wide = wide
        self.count = self.degenerate = self.vertices = self.largest = 0
        self.materials = MaterialColumn(folder, durable)
        self.hierarchy: HierarchyWriter | None = None
        self.locality = Locality()
        names = ["geometry"]
        if kind.boxed:
            names.append("boxes")
        if kind.counted:
            names.append("offsets")
        self.files: dict[str, FileWriter] = {}
        try:
            for name in names:
                self.files[name] = FileWriter(folder / name, durable)
        except BaseException:
            self.abandon()
            raise

    @property
    def number(self) -> int:
        """Return the stream's part of an object id."""
        return stream_number(self.group, self.kind)

    @property
    def label(self) -> str:
        return self.kind.label

    def append(self, block: Prepared, extent: Extent) -> None:
        """Add a block of this kind, of the stream's dtype."""
        if block.bad >= 0:
            raise SceneError(
                f"{self.label} {self.count + block.bad}: found a number that is NaN, infinite or "
                f"too large for float32 boxes, expected finite coordinates"
            )
        n = len(block.materials)
        if "offsets" in self.files:
            self._write_offsets(block.counts)
        self.files["geometry"].write(block.geometry, kept=True)
        if "boxes" in self.files:
            self.files["boxes"].write(block.boxes, kept=True)
        self.materials.append(block.materials)
        extent.add(block.boxes, object_id(self.number, self.count))
        self.locality.add(block.boxes)
        if self.hierarchy is not None:
            self.hierarchy.add(block.boxes)
        self.count += n
        self.degenerate += block.degenerate

    def _write_offsets(self, counts: NDArray[np.uint32]) -> None:
        ends = self.vertices + np.cumsum(counts, dtype=np.uint64)
        if len(ends) and int(ends[-1]) >= 1 << 32:
            raise SceneError(
                f"polygon {self.count}: found more than 2^32 vertices of polygons, expected fewer"
            )
        self.files["offsets"].write(ends.astype("<u4"))
        self.vertices = int(ends[-1]) if len(ends) else self.vertices
        self.largest = max(self.largest, int(counts.max(initial=0)))

    def expect(self, count: int, surface: float, settings: Hierarchy) -> None:
        """Make the first level as the objects come, of which there will be `count`, 1 or more."""
        self.hierarchy = self._hierarchy_writer(settings, surface)
        self.hierarchy.begin(count)

    def make_levels(self, settings: Hierarchy, surface: float, origin: Vector) -> list[Level]:
        """Make the levels of the hierarchy that are missing, from the complete files."""
        if self.hierarchy is None:
            self.hierarchy = self._hierarchy_writer(settings, surface)
        self.hierarchy.complete(self._boxes(origin), self.count)
        return self.hierarchy.levels

    def given(self, origin: Vector) -> GivenFiles:
        """Describe the complete files."""
        materials = self.materials
        layout = Layout(
            self.kind, self.wide, origin, id_bytes_of(self.count), materials.bytes, materials.first
        )
        records = self.vertices if self.kind.counted else self.count
        return GivenFiles(self._folder, layout, self.count, records)

    def _hierarchy_writer(self, settings: Hierarchy, surface: float) -> HierarchyWriter:
        """Return the hierarchy's writer; spheres' boxes are not quantised: records are as small."""
        quantised = settings.bits > 0 and self.kind.boxed
        return HierarchyWriter(
            self._folder, settings, surface, durable=self._durable, quantised=quantised
        )

    def _boxes(self, origin: Vector) -> Boxes:
        """Yield the boxes of the complete stream, block by block."""
        if self.kind.boxed:
            return file_boxes(self.files["boxes"].path)
        return sphere_boxes(self.files["geometry"].path, self.wide, origin)

    def close(self) -> dict[str, Any]:
        """Make the files durable; return the stream's part of the header, without levels."""
        files = {}
        for name, file in self.files.items():
            file.close()
            files[name] = facts_of(file)
        if column := self.materials.close():
            files["materials"] = facts_of(column)
        return {
            "kind": int(self.kind),
            "count": self.count,
            "wide": self.wide,
            "degenerate": self.degenerate,
            "material": self.materials.first,
            "material_bytes": self.materials.bytes,
            "vertices": self.vertices,
            "largest": self.largest,
            "levels": [],
            "quantised": False,
            "id_bytes": 0,
            "treelets": 0,
            "nodes": 0,
            "treelet_bytes": 0,
            "files": files,
        }

    def abandon(self) -> None:
        for file in self.files.values():
            file.abandon()
        self.materials.abandon()
        if self.hierarchy is not None:
            self.hierarchy.abandon()


def file_boxes(path: Path) -> Iterator[NDArray[np.float32]]:
    """Yield the boxes of a complete file of boxes, block by block."""
    for block in _blocks(path, BOX_BYTES):
        yield np.frombuffer(block, "<f4").reshape(-1, 6)


def sphere_boxes(path: Path, wide: bool, origin: Vector) -> Iterator[NDArray[np.float32]]:
    """Yield the boxes of a complete file of spheres, computed again, on all cores."""
    scalar = "<f8" if wide else "<f4"

    def boxes(block: bytes) -> NDArray[np.float32]:
        records = np.frombuffer(block, scalar).reshape(-1, SCALARS[Kind.SPHERE])
        none = np.zeros(len(records), np.uint32)
        return prepare(Kind.SPHERE, records, none, none, origin).boxes

    blocks = _blocks(path, SCALARS[Kind.SPHERE] * int(scalar[2]))
    yield from ahead(boxes, blocks, usable_threads())


def _blocks(path: Path, size: int) -> Iterator[bytes]:
    """Yield a file's records of `size` bytes, up to READ_BACK_AT_ONCE of them at a time."""
    try:
        with path.open("rb") as file:
            while block := file.read(READ_BACK_AT_ONCE * size):
                if len(block) % size:
                    raise ShortReadError(path, file.tell() - len(block) % size, size, len(block))
                yield block
    except OSError as error:
        raise refused(path, 0, error, "reading") from error
