"""A stream's files as they grow: blocks of one kind's objects in, a column a file out.

A block is prepared first, which any thread may do, and then added, in the order of the objects.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from bfrt.errors import SceneError
from bfrt.ids import object_id, stream_number
from bfrt.records import Kind
from bfrt.refusals import refused
from bfrt.store._bounds import bound
from bfrt.store.extent import Extent
from bfrt.store.header import facts_of
from bfrt.store.hierarchy import HierarchyWriter
from bfrt.store.locality import Locality
from bfrt.store.material_column import MaterialColumn
from bfrt.store.model import Vector
from bfrt.streams.writer import FileWriter


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
        self.folder = folder
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
