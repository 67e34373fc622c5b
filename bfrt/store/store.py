"""The scene store: a directory of plain files, and the header that vouches for them.

::

    X.bfrt/
      scene.json                 header: format, origin, bounds, camera, lights, streams, checksums
      made.json                  what was measured while the store was made
      palette                    materials, 32 bytes each
      GROUP/KIND/geometry        records, in input order
      GROUP/KIND/boxes           float32 boxes, rounded outwards (spheres go without)
      GROUP/KIND/offsets         polygons: where each ends, in vertices, uint32
      GROUP/KIND/materials       one integer an object, 1, 2 or 4 bytes (absent: all are the first)
      GROUP/KIND/level1 ...      the hierarchy: boxes around runs of boxes of the level below
      GROUP/KIND/quantised       the objects' boxes again, in 6 bytes each (spheres go without)
      GROUP/KIND/treelets        runs of objects that lie together (in spatial order only)
      GROUP/KIND/nodes           the treelets' trees, 80 bytes a node
      GROUP/KIND/ids             the place that each object had as it was given, uint32 or uint64
      GROUP/marks                voxel marks, made by the first render

``open`` reads the header and asks for the sizes of the files; `Store.verify` reads everything.
"""

from __future__ import annotations

import json
import os
import zlib
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bfrt.errors import StoreError
from bfrt.ids import index_of, stream_number, stream_of
from bfrt.paths import HEADER, MAGIC, header_at, path_of, without_links
from bfrt.records import (
    BOX_BYTES,
    CODE_BYTES,
    MATERIAL,
    NODE_BYTES,
    OFFSET_BYTES,
    PARENT_BYTES,
    SCALARS,
    TREELET_BYTES,
    Kind,
)
from bfrt.refusals import refused
from bfrt.store.extent import NOTHING, Bounds
from bfrt.store.file_facts import FileFacts, check_size, checksum_of, damaged
from bfrt.store.header import HEADER_FIELDS, MADE_FIELDS, digest_of, header_text
from bfrt.store.hierarchy import Hierarchy
from bfrt.store.model import Camera, Light, Vector
from bfrt.streams.litter import restore

VERSION = 5
MADE = "made.json"
PALETTE = "palette"


@dataclass(frozen=True)
class Stream:
    """Describes all objects of one kind in one group."""

    folder: Path
    group: int
    kind: Kind
    count: int
    wide: bool
    degenerate: int
    material: int
    material_bytes: int
    vertices: int
    largest: int
    levels: tuple[int, ...]
    quantised: bool
    id_bytes: int
    treelets: int
    nodes: int
    treelet_bytes: int
    files: dict[str, FileFacts]

    @property
    def number(self) -> int:
        """Return the stream's part of an object id."""
        return stream_number(self.group, self.kind)

    @property
    def stride(self) -> int:
        """Return the bytes of a record; for polygons, of a vertex."""
        return SCALARS[self.kind] * (8 if self.wide else 4)

    @property
    def ordered(self) -> bool:
        """Tell whether objects are in spatial order, in treelets."""
        return self.id_bytes > 0

    @property
    def boxed(self) -> bool:
        """Tell whether boxes are stored; others are worked out of the records, of one size."""
        return self.kind.boxed and (self.kind.counted or not self.ordered)

    def path(self, name: str) -> Path:
        return self.folder / name

    def expected_bytes(self) -> dict[str, int]:
        """Return the size of each file, bytes, that the counts imply."""
        records = self.vertices if self.kind.counted else self.count
        sizes = {"geometry": records * self.stride}
        if self.boxed:
            sizes["boxes"] = self.count * BOX_BYTES
        if self.kind.counted:
            sizes["offsets"] = self.count * OFFSET_BYTES
        if self.material_bytes:
            sizes["materials"] = self.count * self.material_bytes
        for number, count in enumerate(self.levels, 1):
            sizes[f"level{number}"] = count * PARENT_BYTES
        if self.quantised:
            sizes["quantised"] = self.count * CODE_BYTES
        if self.ordered:
            sizes["ids"] = self.count * self.id_bytes
            sizes["nodes"] = self.nodes * NODE_BYTES
            sizes["treelets"] = self.treelets * TREELET_BYTES
        return sizes


@dataclass(frozen=True)
class Group:
    """Describes objects that share a grid."""

    number: int
    streams: list[Stream]
    grid_bounds: Bounds
    outliers: list[int]

    @property
    def gridded(self) -> int:
        """Return the number of objects in the grid."""
        return sum(s.count - s.degenerate for s in self.streams) - len(self.outliers)

    @property
    def quantised_checksum(self) -> int:
        """Return a checksum of quantised boxes and of the boxes around them; 0 if none."""
        crc = 0
        for stream in self.streams:
            if stream.quantised:
                for name in ("level1", "quantised"):
                    crc = zlib.crc32(stream.files[name].crc32.to_bytes(4, "little"), crc)
        return crc


@dataclass(frozen=True)
class Store:
    """Holds the header of an open scene store, not its data.

    Attributes
    ----------
    path : Path
        Where it is.
    origin : tuple of 3 float
        The point that boxes and float32 coordinates are relative to, world coordinates.
    bounds : Bounds
        The box around all objects, ``lo`` and ``hi`` (3,) float64, relative to the origin;
        ``empty`` where there are none.
    camera : Camera, optional
        The view that is rendered where no other is asked for.
    lights : list of Light
    background : tuple of 3 float
        The color that rays see that hit nothing.
    """

    path: Path
    origin: tuple[float, float, float]
    bounds: Bounds
    groups: list[Group]
    camera: Camera | None
    lights: list[Light]
    background: tuple[float, float, float]
    palette: FileFacts
    hierarchy: Hierarchy
    hierarchy_seconds: float
    checksum: int
    header_bytes: int = field(repr=False)

    @property
    def streams(self) -> list[Stream]:
        return [stream for group in self.groups for stream in group.streams]

    @property
    def ordered(self) -> bool:
        """Tell whether all objects are in spatial order, in treelets."""
        return all(stream.ordered for stream in self.streams)

    @property
    def world_bounds(self) -> Bounds:
        """Return the box around all objects in world coordinates: `bounds` plus the origin."""
        return Bounds(self.bounds.lo + self.origin, self.bounds.hi + self.origin)

    @property
    def objects(self) -> int:
        return sum(stream.count for stream in self.streams)

    @property
    def bytes(self) -> int:
        """Return the bytes on disk, without marks."""
        files = sum(f.bytes for s in self.streams for f in s.files.values())
        return files + self.palette.bytes + self.header_bytes

    def files(self) -> list[tuple[Path, FileFacts]]:
        """Return every file that the header lists."""
        listed = [(s.path(name), f) for s in self.streams for name, f in s.files.items()]
        return [*listed, (self.path / PALETTE, self.palette)]

    def materials(self) -> NDArray[Any]:
        """Return the palette, (materials,) of records.MATERIAL.

        Raises
        ------
        StoreError
            If it is not what the header says.
        StreamError
            As the system refuses.
        """
        path = self.path / PALETTE
        try:
            data = path.read_bytes()
        except OSError as error:
            raise refused(path, 0, error, "reading") from error
        if len(data) != self.palette.bytes or zlib.crc32(data) != self.palette.crc32:
            raise damaged(path, self.palette)
        return np.frombuffer(data, MATERIAL)

    def verify(self) -> None:
        """Read every file and compare checksums.

        Raises
        ------
        StoreError
            If a file differs from what was written; it names the first. `Scene.verify` reads the
            marks too.
        """
        open_store(self.path)
        for path, facts in self.files():
            if checksum_of(path) != (facts.crc32, facts.bytes):
                raise damaged(path, facts)


def open_store(path: str | os.PathLike[str]) -> Store:
    """Open a store: read its header, check the sizes of its files.

    Raises
    ------
    StoreError
        If it is not a store, of another version, damaged or truncated.
    """
    path = path_of("store", path)
    file = path / HEADER
    try:
        data = _data_of(file)
    except (FileNotFoundError, NotADirectoryError, IsADirectoryError):
        raise StoreError(f"{path}: not a scene store: expected a directory with {HEADER}") from None
    except OSError as error:
        raise refused(file, 0, error, "reading") from error
    store = _parse(path, data)
    for stream in store.streams:
        _check_sizes(stream)
    check_size(path / PALETTE, store.palette.bytes)
    return store


def _data_of(file: Path) -> bytes:
    """Return a header's text, also where the replacement of its store has ended half-way."""
    try:
        return file.read_bytes()
    except FileNotFoundError:
        if not restore(without_links(file.parent)):
            raise
    return file.read_bytes()


def has_magic(path: Path) -> bool:
    """Tell whether a directory is a scene store of any version, which another may replace."""
    try:
        return bool(json.loads(header_at(path))["magic"] == MAGIC)
    except (ValueError, KeyError, TypeError, RecursionError):
        return False


def _parse(path: Path, data: bytes) -> Store:
    file = path / HEADER
    try:
        header = json.loads(data)
        magic = header["magic"]
        version = header["version"]
    except (ValueError, KeyError, TypeError, RecursionError):
        raise StoreError(f"{file}: not a scene store: expected a header of bfrt") from None
    if magic != MAGIC:
        raise StoreError(f"{file}: found {magic!r:.80}, expected {MAGIC!r}")
    if version != VERSION:
        raise StoreError(
            f"{file}: found format version {version!r:.40}, expected {VERSION}: "
            "convert the scene again with this version of bfrt"
        )
    if not _is_whole(header, data):
        raise StoreError(f"{file}: the header is damaged: its checksum does not match")
    try:
        return _store(path, HEADER_FIELDS(header), digest_of(header), len(data))
    except (ValueError, KeyError, TypeError) as error:
        raise StoreError(f"{file}: {error}") from None


def _is_whole(header: dict[str, Any], data: bytes) -> bool:
    """Tell whether the text is the one that its contents, and so its checksum, make."""
    try:
        return header_text(header).encode() == data
    except (ValueError, RecursionError):  # NaN, or nested without end
        return False


def _store(path: Path, header: dict[str, Any], digest: int, size: int) -> Store:
    store = Store(
        path=path,
        origin=header["origin"],
        bounds=bounds_from(header["bounds"]),
        groups=[_group(path, number, g) for number, g in enumerate(header["groups"])],
        camera=header["camera"],
        lights=list(header["lights"]),
        background=header["background"],
        palette=FileFacts(**header["palette"]),
        hierarchy=Hierarchy(**header["hierarchy"]),
        hierarchy_seconds=_made(path / MADE),
        checksum=digest,
        header_bytes=size,
    )
    materials, rest = divmod(store.palette.bytes, MATERIAL.itemsize)
    if rest or any(s.material >= materials for s in store.streams if s.count):
        raise ValueError(f"palette: found {store.palette.bytes} bytes, expected all materials")
    if not store.groups:
        raise ValueError("groups: found none, expected one or more")
    return store


def _made(file: Path) -> float:
    """Return the seconds that the hierarchy took."""
    try:
        data = file.read_bytes()
    except (FileNotFoundError, NotADirectoryError):
        raise StoreError(f"{file}: the file is missing") from None
    except OSError as error:
        raise refused(file, 0, error, "reading") from error
    try:
        made = json.loads(data)
        if _is_whole(made, data):
            return float(MADE_FIELDS(made)["hierarchy_seconds"])
    except (ValueError, KeyError, TypeError, AttributeError, RecursionError):
        pass
    raise StoreError(f"{file}: the file is damaged: its checksum does not match")


def _group(path: Path, number: int, group: dict[str, Any]) -> Group:
    streams = []
    for stream in group["streams"]:
        kind = Kind(stream["kind"])
        facts = {name: FileFacts(**f) for name, f in stream["files"].items()}
        rest = {k: v for k, v in stream.items() if k not in ("kind", "files")}
        folder = path / str(number) / kind.label
        streams.append(Stream(folder=folder, group=number, kind=kind, files=facts, **rest))
    counts = {s.number: s.count for s in streams}
    outliers = list(group["outliers"])
    for id in outliers:
        if index_of(id) >= counts.get(stream_of(id), 0):
            raise ValueError(f"outliers: found id {id}, expected an object of group {number}")
    made = Group(number, streams, bounds_from(group["grid_bounds"]), outliers)
    if made.gridded < 0 or (made.gridded > 0 and made.grid_bounds.empty):
        raise ValueError(f"groups: found {made.gridded} objects in a grid that does not fit them")
    return made


def bounds_from(value: tuple[Vector, Vector] | None) -> Bounds:
    """Return the bounds of a header's two corners, or empty bounds for None."""
    return NOTHING if value is None else Bounds(np.array(value[0]), np.array(value[1]))


def bounds_to(bounds: Bounds) -> list[list[float]] | None:
    return None if bounds.empty else [bounds.lo.tolist(), bounds.hi.tolist()]


def _check_sizes(stream: Stream) -> None:
    expected = stream.expected_bytes()
    if {name: facts.bytes for name, facts in stream.files.items()} != expected:
        raise StoreError(f"{stream.folder}: the header contradicts its own counts")
    for name, size in expected.items():
        check_size(stream.path(name), size)
