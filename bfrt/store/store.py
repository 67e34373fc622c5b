"""The scene store: a directory of plain files, and the header that vouches for them.

::

    X.bfrt/
      scene.json                 header: format, origin, crs, bounds, view, streams, checksums
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
      GROUP/shared-marks         likewise, as a shard of a larger scene (bfrt.shards)

``open`` reads the header and asks for the sizes of the files; `Store.verify` reads everything.
"""

from __future__ import annotations

import json
import os
import zlib
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from bfrt.errors import StoreError
from bfrt.ids import index_of, stream_of
from bfrt.image.color_scale import ColorScale
from bfrt.paths import HEADER, MAGIC, header_at, path_of
from bfrt.records import MATERIAL, Kind
from bfrt.store.extent import NOTHING, Bounds
from bfrt.store.file_facts import FileFacts, checksum_of, damaged
from bfrt.store.folder import StoreFolder
from bfrt.store.header import HEADER_FIELDS, MADE_FIELDS, digest_of, header_text
from bfrt.store.hierarchy import Hierarchy
from bfrt.store.model import Camera, Light, Vector
from bfrt.store.stream import Stream

VERSION = 5
MADE = "made.json"
PALETTE = "palette"
MARKS = "marks"


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
    folder : StoreFolder
        The folder, opened: what is read is in there.
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
    crs : str
        The reference system of coordinates, as "EPSG:32632" or WKT; empty where none was given.
    colors : tuple of ColorScale
        What colors say, where a map has made them of numbers.
    """

    folder: StoreFolder
    origin: tuple[float, float, float]
    bounds: Bounds
    groups: list[Group]
    camera: Camera | None
    lights: list[Light]
    background: tuple[float, float, float]
    crs: str
    colors: tuple[ColorScale, ...]
    palette: FileFacts
    hierarchy: Hierarchy
    hierarchy_seconds: float
    checksum: int
    header_bytes: int = field(repr=False)

    @property
    def path(self) -> Path:
        """Return where it was opened."""
        return self.folder.path

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

    def moved(self, path: Path) -> Store:
        """Return this store under the name that its folder has got."""
        there = self.folder.path
        groups = [
            replace(
                group,
                streams=[
                    replace(stream, folder=path / stream.folder.relative_to(there))
                    for stream in group.streams
                ],
            )
            for group in self.groups
        ]
        self.folder.move(path)
        return replace(self, groups=groups)

    def marks_of(self, group: Group) -> Path:
        """Return the path of a group's marks, where we may write to the store."""
        return self.path / str(group.number) / MARKS

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
        data = self.folder.read(path)
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
        self.folder.check()
        self.check_sizes()
        for path, facts in self.files():
            if checksum_of(path, opener=self.folder.opener) != (facts.crc32, facts.bytes):
                raise self.folder.fault() or damaged(path, facts)

    def check_sizes(self) -> None:
        """Refuse files that are missing, or of other sizes than the header says.

        Raises
        ------
        StoreError
            If one is.
        """
        for path, facts in self.files():
            self.folder.examine(path, facts.bytes)


def open_store(path: str | os.PathLike[str]) -> Store:
    """Open a store: read its header, check the sizes of its files.

    Raises
    ------
    StoreError
        If it is not a store, of another version, damaged or truncated.
    """
    path = path_of("store", path)
    folder = StoreFolder(path)
    with folder.closed_on_error():
        store = _parse(folder)
        store.check_sizes()
    return store


def has_magic(path: Path) -> bool:
    """Tell whether a directory is a scene store of any version, which another may replace."""
    try:
        return bool(json.loads(header_at(path))["magic"] == MAGIC)
    except (ValueError, KeyError, TypeError, RecursionError):
        return False


def _parse(folder: StoreFolder) -> Store:
    file, data = folder.path / HEADER, folder.header
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
        return _store(folder, HEADER_FIELDS(header), digest_of(header))
    except StoreError:
        raise
    except (ValueError, KeyError, TypeError) as error:
        raise StoreError(f"{file}: {error}") from None


def _is_whole(header: dict[str, Any], data: bytes) -> bool:
    """Tell whether the text is the one that its contents, and so its checksum, make."""
    try:
        return header_text(header).encode() == data
    except (ValueError, RecursionError):  # NaN, or nested without end
        return False


def _store(folder: StoreFolder, header: dict[str, Any], digest: int) -> Store:
    made = _made(folder)
    store = Store(
        folder=folder,
        origin=header["origin"],
        bounds=bounds_from(header["bounds"]),
        groups=[_group(folder, number, g, made.local) for number, g in enumerate(header["groups"])],
        camera=header["camera"],
        lights=list(header["lights"]),
        background=header["background"],
        crs=header.get("crs", ""),
        colors=header.get("colors", ()),
        palette=FileFacts(**header["palette"]),
        hierarchy=Hierarchy(**header["hierarchy"]),
        hierarchy_seconds=made.hierarchy_seconds,
        checksum=digest,
        header_bytes=len(folder.header),
    )
    materials, rest = divmod(store.palette.bytes, MATERIAL.itemsize)
    if rest or any(s.material >= materials for s in store.streams if s.count):
        raise ValueError(f"palette: found {store.palette.bytes} bytes, expected all materials")
    if not store.groups:
        raise ValueError("groups: found none, expected one or more")
    return store


class Made(NamedTuple):
    """Holds what was measured while a store was made.

    Attributes
    ----------
    hierarchy_seconds : float
        What levels and order have taken.
    local : tuple of str
        The streams whose objects came in local order, as GROUP/KIND.
    """

    hierarchy_seconds: float
    local: tuple[str, ...]


def _made(folder: StoreFolder) -> Made:
    """Return what was measured; a store that does not tell of order has none that is known."""
    file = folder.path / MADE
    data = folder.read(file)
    try:
        made = json.loads(data)
        if _is_whole(made, data):
            facts = MADE_FIELDS({"local": [], **made})
            return Made(facts["hierarchy_seconds"], facts["local"])
    except (ValueError, KeyError, TypeError, AttributeError, RecursionError):
        pass
    raise StoreError(f"{file}: the file is damaged: its checksum does not match")


def _group(home: StoreFolder, number: int, group: dict[str, Any], local: tuple[str, ...]) -> Group:
    streams = []
    for stream in group["streams"]:
        kind = Kind(stream["kind"])
        facts = {name: FileFacts(**f) for name, f in stream["files"].items()}
        rest = {k: v for k, v in stream.items() if k not in ("kind", "files")}
        folder = home.path / str(number) / kind.label
        in_order = f"{number}/{kind.label}" in local
        made = Stream(home, folder, in_order, group=number, kind=kind, files=facts, **rest)
        made.check_header()
        streams.append(made)
    counts = {s.number: s.count for s in streams}
    outliers = list(group["outliers"])
    for id in outliers:
        if index_of(id) >= counts.get(stream_of(id), 0):
            raise ValueError(f"outliers: found id {id}, expected an object of group {number}")
    whole = Group(number, streams, bounds_from(group["grid_bounds"]), outliers)
    if whole.gridded < 0 or (whole.gridded > 0 and whole.grid_bounds.empty):
        raise ValueError(f"groups: found {whole.gridded} objects in a grid that does not fit them")
    return whole


def bounds_from(value: tuple[Vector, Vector] | None) -> Bounds:
    """Return the bounds of a header's two corners, or empty bounds for None."""
    return NOTHING if value is None else Bounds(np.array(value[0]), np.array(value[1]))


def bounds_to(bounds: Bounds) -> list[list[float]] | None:
    return None if bounds.empty else [bounds.lo.tolist(), bounds.hi.tolist()]
