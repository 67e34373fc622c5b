"""The scene store: a directory of plain files, and the header that vouches for them.

::

    X.bfrt/
      scene.json                 header: format, origin, bounds, camera, lights, streams, checksums
      palette                    materials, 32 bytes each
      GROUP/KIND/geometry        records, in input order
      GROUP/KIND/boxes           float32 boxes, rounded outwards (spheres go without)
      GROUP/KIND/offsets         polygons: where each ends, in vertices, uint32
      GROUP/KIND/materials       one integer an object, 1, 2 or 4 bytes (absent: all are the first)
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

from bfrt.errors import StoreError, StreamError
from bfrt.records import BOX_BYTES, INDEX_BITS, MATERIAL, OFFSET_BYTES, SCALARS, Kind
from bfrt.scene.extent import NOTHING, Bounds
from bfrt.scene.model import Camera, Light

MAGIC = "bfrt scene store"
VERSION = 1
HEADER = "scene.json"
PALETTE = "palette"


@dataclass(frozen=True)
class FileFacts:
    """What the header knows of a file."""

    bytes: int
    crc32: int


@dataclass(frozen=True)
class Stream:
    """All objects of one kind in one group."""

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
    files: dict[str, FileFacts]

    @property
    def number(self) -> int:
        """The stream's part of an object id."""
        return self.group * len(Kind) + self.kind

    @property
    def stride(self) -> int:
        """Bytes of a record; of a vertex, for polygons."""
        return SCALARS[self.kind] * (8 if self.wide else 4)

    def path(self, name: str) -> Path:
        return self.folder / name

    def expected_bytes(self) -> dict[str, int]:
        """The sizes that the counts imply."""
        records = self.vertices if self.kind == Kind.POLYGON else self.count
        sizes = {"geometry": records * self.stride}
        if self.kind != Kind.SPHERE:
            sizes["boxes"] = self.count * BOX_BYTES
        if self.kind == Kind.POLYGON:
            sizes["offsets"] = self.count * OFFSET_BYTES
        if self.material_bytes:
            sizes["materials"] = self.count * self.material_bytes
        return sizes


@dataclass(frozen=True)
class Group:
    """Objects that share a grid."""

    number: int
    streams: list[Stream]
    grid_bounds: Bounds
    outliers: list[int]

    @property
    def gridded(self) -> int:
        """Objects in the grid."""
        return sum(s.count - s.degenerate for s in self.streams) - len(self.outliers)


@dataclass(frozen=True)
class Store:
    """An open scene store: the header, not the data."""

    path: Path
    origin: tuple[float, float, float]
    bounds: Bounds
    groups: list[Group]
    camera: Camera | None
    lights: list[Light]
    background: tuple[float, float, float]
    palette: FileFacts
    checksum: int
    header_bytes: int = field(repr=False)

    @property
    def streams(self) -> list[Stream]:
        return [stream for group in self.groups for stream in group.streams]

    @property
    def objects(self) -> int:
        return sum(stream.count for stream in self.streams)

    @property
    def bytes(self) -> int:
        """Bytes on disk, without marks."""
        files = sum(f.bytes for s in self.streams for f in s.files.values())
        return files + self.palette.bytes + self.header_bytes

    def files(self) -> list[tuple[Path, FileFacts]]:
        """Every file that the header vouches for."""
        listed = [(s.path(name), f) for s in self.streams for name, f in s.files.items()]
        return [*listed, (self.path / PALETTE, self.palette)]

    def materials(self) -> NDArray[Any]:
        """The palette, (materials,) of records.MATERIAL.

        Raises
        ------
        StoreError
            If it is not what the header says.
        """
        data = (self.path / PALETTE).read_bytes()
        if len(data) != self.palette.bytes or zlib.crc32(data) != self.palette.crc32:
            raise damaged(self.path / PALETTE, self.palette)
        return np.frombuffer(data, MATERIAL)

    def verify(self) -> None:
        """Read every file and compare checksums.

        Raises
        ------
        StoreError
            For the first file that differs from what was written, marks included.
        """
        from bfrt.scene.marks import verify_marks

        open_store(self.path)
        for path, facts in self.files():
            if checksum_of(path) != (facts.crc32, facts.bytes):
                raise damaged(path, facts)
        for group in self.groups:
            verify_marks(self, group)


def damaged(path: Path, facts: FileFacts) -> StoreError:
    return StoreError(
        f"{path}: the contents differ from what was written: "
        f"expected {facts.bytes} bytes with CRC-32 {facts.crc32:08x}"
    )


def checksum_of(path: Path) -> tuple[int, int]:
    """CRC-32 and length of a file, read in blocks."""
    crc = length = 0
    try:
        with path.open("rb") as file:
            while block := file.read(1 << 22):
                crc = zlib.crc32(block, crc)
                length += len(block)
    except OSError as error:
        raise StreamError(path, length, error.errno or 0, "reading") from error
    return crc, length


def header_text(header: dict[str, Any]) -> str:
    """The one text of a header: sorted, indented, with its own checksum."""
    body = {key: value for key, value in header.items() if key != "checksum"}
    text = json.dumps(body, indent=1, sort_keys=True, allow_nan=False)
    body["checksum"] = zlib.crc32(text.encode())
    return json.dumps(body, indent=1, sort_keys=True, allow_nan=False) + "\n"


def open_store(path: str | os.PathLike[str]) -> Store:
    """Open a store: read its header, check the sizes of its files.

    Raises
    ------
    StoreError
        If it is not a store, of another version, damaged or truncated.
    """
    path = Path(path)
    file = path / HEADER
    try:
        data = file.read_bytes()
    except (FileNotFoundError, NotADirectoryError):
        raise StoreError(f"{path}: not a scene store: expected a directory with {HEADER}") from None
    except OSError as error:
        raise StreamError(file, 0, error.errno or 0, "reading") from error
    store = _parse(path, data)
    for stream in store.streams:
        _check_sizes(stream)
    _check_size(path / PALETTE, store.palette.bytes)
    return store


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
    if header_text(header).encode() != data:
        raise StoreError(f"{file}: the header is damaged: its checksum does not match")
    return _store(path, header, len(data))


def _store(path: Path, header: dict[str, Any], size: int) -> Store:
    camera = header["camera"]
    return Store(
        path=path,
        origin=tuple(header["origin"]),
        bounds=bounds_from(header["bounds"]),
        groups=[_group(path, number, g) for number, g in enumerate(header["groups"])],
        camera=None if camera is None else Camera(**{k: _tuple(v) for k, v in camera.items()}),
        lights=[Light(_tuple(p), _tuple(c)) for p, c in header["lights"]],
        background=_tuple(header["background"]),
        palette=FileFacts(**header["palette"]),
        checksum=header["checksum"],
        header_bytes=size,
    )


def _tuple(value: Any) -> Any:
    return tuple(value) if isinstance(value, list) else value


def _group(path: Path, number: int, group: dict[str, Any]) -> Group:
    streams = []
    for stream in group["streams"]:
        kind = Kind(stream["kind"])
        facts = {name: FileFacts(**f) for name, f in stream["files"].items()}
        rest = {k: v for k, v in stream.items() if k not in ("kind", "files")}
        folder = path / str(number) / kind.label
        streams.append(Stream(folder=folder, group=number, kind=kind, files=facts, **rest))
    return Group(number, streams, bounds_from(group["grid_bounds"]), group["outliers"])


def bounds_from(value: list[list[float]] | None) -> Bounds:
    """Bounds as a header has them: two lists, or nothing at all."""
    return NOTHING if value is None else Bounds(np.array(value[0]), np.array(value[1]))


def bounds_to(bounds: Bounds) -> list[list[float]] | None:
    return None if bounds.empty else [bounds.lo.tolist(), bounds.hi.tolist()]


def _check_sizes(stream: Stream) -> None:
    expected = stream.expected_bytes()
    for name, size in expected.items():
        if name not in stream.files or stream.files[name].bytes != size:
            raise StoreError(f"{stream.path(name)}: the header contradicts its own counts")
        _check_size(stream.path(name), size)


def _check_size(path: Path, size: int) -> None:
    try:
        found = path.stat().st_size
    except FileNotFoundError:
        raise StoreError(f"{path}: the file is missing: expected {size} bytes") from None
    except OSError as error:
        raise StreamError(path, 0, error.errno or 0, "examining") from error
    if found != size:
        raise StoreError(f"{path}: found {found} bytes, expected {size}: the store is truncated")


def object_id(stream: int, index: int) -> int:
    """The 64-bit id of an object."""
    return stream << INDEX_BITS | index
