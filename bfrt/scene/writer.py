"""SceneWriter: blocks of NumPy arrays in, a scene store out.

Everything is written under a temporary name, made durable and renamed at the end, so that what
opens is whole. Blocks pass through once: geometry as given, boxes and materials beside it.
"""

from __future__ import annotations

import contextlib
import logging
import os
import shutil
from collections import OrderedDict
from collections.abc import Iterable, Sequence
from dataclasses import asdict
from pathlib import Path
from types import TracebackType
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from bfrt.errors import SceneError, SettingError
from bfrt.records import INDEX_BITS, MATERIAL, SCALARS, Kind
from bfrt.scene._bounds import bound
from bfrt.scene.extent import Extent
from bfrt.scene.model import Camera, Light, Material, Vector
from bfrt.scene.store import (
    HEADER,
    MAGIC,
    PALETTE,
    VERSION,
    Store,
    bounds_to,
    header_text,
    open_store,
)
from bfrt.streams.aside import refused
from bfrt.streams.writer import FileWriter

log = logging.getLogger(__name__)

#: Distinct materials that are remembered, so that a repeated one is stored once.
REMEMBERED = 65536

#: Objects whose boxes are worked out at once: what bounds memory beside the caller's block.
BLOCK = 65536


class MaterialColumn:
    """A stream's materials in the smallest integers that fit; nothing while there is only one."""

    def __init__(self, folder: Path) -> None:
        self._path = folder / "materials"
        self._file: FileWriter | None = None
        self._count = 0
        self.first = 0
        self.bytes = 0

    def append(self, materials: NDArray[np.uint32]) -> None:
        if self._count == 0 and len(materials):
            self.first = int(materials[0])
        top = int(materials.max(initial=0))
        if self.bytes == 0 and not (materials == self.first).all():
            self._widen(1)
        while self.bytes and top >> (8 * self.bytes):
            self._widen(self.bytes * 2)
        if self._file is not None:
            self._file.write(materials.astype(f"<u{self.bytes}"))
        self._count += len(materials)

    def _widen(self, width: int) -> None:
        """Write what there is again, in wider integers."""
        old, old_bytes = self._file, self.bytes
        wider = FileWriter(self._path.with_suffix(f".{width}"))
        self._file, self.bytes = wider, width
        if old is None:
            for done in range(0, self._count, BLOCK):
                n = min(BLOCK, self._count - done)
                wider.write(np.full(n, self.first, f"<u{width}"))
            return
        old.close()
        with old.path.open("rb") as file:
            while block := file.read(BLOCK):
                wider.write(np.frombuffer(block, f"<u{old_bytes}").astype(f"<u{width}"))
        old.path.unlink()

    def close(self) -> FileWriter | None:
        if self._file is not None:
            self._file.close()
            self._file.path.rename(self._path)
        return self._file

    def abandon(self) -> None:
        if self._file is not None:
            self._file.abandon()


class StreamWriter:
    """One kind's files as they grow."""

    def __init__(self, folder: Path, group: int, kind: Kind, wide: bool) -> None:
        folder.mkdir(parents=True)
        self.group = group
        self.kind = kind
        self.wide = wide
        self.count = self.degenerate = self.vertices = self.largest = 0
        self.materials = MaterialColumn(folder)
        names = ["geometry"]
        if kind != Kind.SPHERE:
            names.append("boxes")
        if kind == Kind.POLYGON:
            names.append("offsets")
        self.files = {name: FileWriter(folder / name) for name in names}

    @property
    def label(self) -> str:
        return self.kind.label

    def append(
        self,
        records: NDArray[np.floating],
        counts: NDArray[np.uint32],
        materials: NDArray[np.uint32],
        origin: Vector,
        extent: Extent,
    ) -> None:
        """Add records (n, scalars), or vertices (m, 3) of n polygons, of the stream's dtype."""
        n = len(materials)
        boxes = np.empty((n, 6), np.float32)
        flat = np.ascontiguousarray(records).reshape(-1).view(np.uint8)
        degenerate, bad = bound(
            self.kind, flat, counts, self.wide, origin, SCALARS[self.kind], boxes
        )
        if bad >= 0:
            raise SceneError(
                f"{self.label} {self.count + bad}: found a number that is NaN, infinite or too "
                f"large for float32 boxes, expected finite coordinates"
            )
        self.files["geometry"].write(flat)
        if "boxes" in self.files:
            self.files["boxes"].write(boxes)
        if "offsets" in self.files:
            self._write_offsets(counts)
        self.materials.append(materials)
        stream = self.group * len(Kind) + self.kind
        first = (stream << INDEX_BITS) + self.count
        extent.add(boxes, np.arange(first, first + n, dtype=np.uint64))
        self.count += n
        self.degenerate += degenerate

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
        """Make the files durable; returns the stream's part of the header."""
        files = {}
        for name, file in self.files.items():
            file.close()
            files[name] = {"bytes": file.bytes, "crc32": file.checksum}
        if column := self.materials.close():
            files["materials"] = {"bytes": column.bytes, "crc32": column.checksum}
        return {
            "kind": int(self.kind),
            "count": self.count,
            "wide": self.wide,
            "degenerate": self.degenerate,
            "material": self.materials.first,
            "material_bytes": self.materials.bytes,
            "vertices": self.vertices,
            "largest": self.largest,
            "files": files,
        }

    def abandon(self) -> None:
        for file in self.files.values():
            file.abandon()
        self.materials.abandon()


class SceneWriter:
    """Write a scene store, block by block.

    Parameters
    ----------
    path : path-like
        The store to make. A store that is there is replaced when this one is complete; anything
        else that is there is refused.
    dtype : {None, "float32", "float64"}
        What geometry is stored as. None keeps float32 as it is and everything else as float64.
    origin : (3,) array_like, optional
        What boxes and float32 coordinates are relative to, world units. By default zero where
        the first block is float32, and the center of the first block where it is float64.

    Raises
    ------
    SceneError
        For coordinates that are not finite, shapes that do not fit, materials that do not exist.
    DiskFullError, StreamError
        As the system refuses; nothing is left behind.

    Examples
    --------
    >>> with bfrt.SceneWriter("cloud.bfrt") as writer:
    ...     for centers, radii in blocks:
    ...         writer.spheres(centers, radii)
    """

    def __init__(
        self,
        path: str | os.PathLike[str],
        *,
        dtype: Any = None,
        origin: ArrayLike | None = None,
    ) -> None:
        self.path = Path(path)
        if dtype is not None and np.dtype(dtype) not in (np.float32, np.float64):
            raise SettingError(f"dtype: found {dtype!r}, expected float32, float64 or None")
        self._dtype = None if dtype is None else np.dtype(dtype)
        self._origin = None if origin is None else _triple("origin", origin)
        self._streams: dict[Kind, StreamWriter] = {}
        self._extent = Extent()
        self._camera: Camera | None = None
        self._lights: list[Light] = []
        self._background: Vector = (0.0, 0.0, 0.0)
        self._remembered: OrderedDict[Material, int] = OrderedDict()
        self._materials = 0
        if self.path.exists() and not (self.path / HEADER).is_file():
            raise SettingError(f"{self.path}: exists and is no scene store: it is not replaced")
        self._aside = self.path.with_name(f".{self.path.name}.{os.getpid()}.part")
        try:
            shutil.rmtree(self._aside, ignore_errors=True)
            (self._aside / "0").mkdir(parents=True)  # the group, which may stay without objects
        except OSError as error:
            raise refused(self._aside, 0, error, "creating") from error
        self._palette = FileWriter(self._aside / PALETTE)

    def camera(self, camera: Camera) -> None:
        """Set the view that is rendered where no other is asked for."""
        self._camera = camera

    def light(self, light: Light) -> None:
        """Add a point light."""
        self._lights.append(light)

    def background(self, color: Vector) -> None:
        """Set the color that rays see that hit nothing."""
        self._background = color

    def material(self, material: Material) -> int:
        """Add a material to the palette; returns its index. A repeated one is found again."""
        index = self._remembered.get(material)
        if index is not None:
            return index
        row = np.array([(*material.color, *material[1:])], MATERIAL)
        numbers = row.view("<f4")
        if not np.isfinite(numbers).all() or (numbers < 0).any():
            raise SceneError(f"material: found {material}, expected finite numbers, none negative")
        self._palette.write(row.view(np.uint8))
        index = self._materials
        self._materials += 1
        self._remembered[material] = index
        if len(self._remembered) > REMEMBERED:
            self._remembered.popitem(last=False)
        return index

    def spheres(
        self, centers: ArrayLike, radii: ArrayLike, materials: ArrayLike | None = None
    ) -> None:
        """Add spheres: centers (n, 3), radii (n,), material index or indices (n,)."""
        c, n = _rows("centers", centers, (3,))
        self.append(Kind.SPHERE, np.hstack([c, _column("radii", radii, n, c.dtype)]), materials)

    def cones(
        self,
        bases: ArrayLike,
        base_radii: ArrayLike,
        apexes: ArrayLike,
        apex_radii: ArrayLike,
        materials: ArrayLike | None = None,
    ) -> None:
        """Add cones without caps: ends (n, 3) and radii (n,). Equal radii make cylinders."""
        a, n = _rows("bases", bases, (3,))
        b, m = _rows("apexes", apexes, (3,))
        if n != m:
            raise SceneError(f"apexes: found {m} rows, expected {n}, as many as bases")
        ra = _column("base_radii", base_radii, n, a.dtype)
        rb = _column("apex_radii", apex_radii, n, a.dtype)
        if (ra * rb < 0).any():
            raise SceneError("cones: found radii of both signs in one cone, expected one sign")
        self.append(Kind.CONE, np.hstack([a, ra, b, rb]), materials)

    def triangles(self, vertices: ArrayLike, materials: ArrayLike | None = None) -> None:
        """Add triangles: vertices (n, 3, 3), counterclockwise from outside."""
        v, n = _rows("vertices", vertices, (3, 3))
        self.append(Kind.TRIANGLE, v.reshape(n, 9), materials)

    def patches(
        self, vertices: ArrayLike, normals: ArrayLike, materials: ArrayLike | None = None
    ) -> None:
        """Add triangles with vertex normals for smooth shading, both (n, 3, 3)."""
        v, n = _rows("vertices", vertices, (3, 3))
        normal, m = _rows("normals", normals, (3, 3))
        if n != m:
            raise SceneError(f"normals: found {m} rows, expected {n}, as many as vertices")
        self.append(Kind.PATCH, np.hstack([v.reshape(n, 9), normal.reshape(n, 9)]), materials)

    def polygons(
        self, vertices: ArrayLike, counts: ArrayLike, materials: ArrayLike | None = None
    ) -> None:
        """Add polygons: the vertices of all (m, 3), one after another, and counts (n,) >= 3.

        A polygon of three vertices is stored as a triangle and numbered among those.
        """
        v, _ = _rows("vertices", vertices, (3,))
        self.append_polygons(v, np.asarray(counts), materials)

    def append(self, kind: Kind, records: NDArray[Any], materials: ArrayLike | None = None) -> None:
        """Add records (n, scalars) of one kind other than polygons, laid out as on disk."""
        if records.ndim != 2 or records.shape[1] != SCALARS[kind] or kind == Kind.POLYGON:
            raise SceneError(
                f"{kind.label}: found records of shape {records.shape}, "
                f"expected (n, {SCALARS[kind]})"
            )
        indices = self._material_indices(materials, len(records))
        for first in range(0, len(records), BLOCK):
            last = first + BLOCK
            part = indices[first:last]
            self._append(kind, records[first:last], np.zeros(len(part), np.uint32), part)

    def append_polygons(
        self, vertices: NDArray[Any], counts: NDArray[Any], materials: ArrayLike | None = None
    ) -> None:
        """Add polygons of vertices (m, 3) and counts (n,)."""
        if counts.ndim != 1 or (counts < 3).any() or int(counts.sum()) != len(vertices):
            raise SceneError(
                f"polygons: found {len(vertices)} vertices for counts of "
                f"{int(counts.sum())} in all, expected as many, each count 3 or more"
            )
        indices = self._material_indices(materials, len(counts))
        three = counts == 3
        if three.any():
            in_triangle = np.repeat(three, counts)
            self.append(Kind.TRIANGLE, vertices[in_triangle].reshape(-1, 9), indices[three])
            vertices, counts, indices = vertices[~in_triangle], counts[~three], indices[~three]
        if len(counts):
            self._append(Kind.POLYGON, vertices, counts.astype(np.uint32), indices)

    def _append(
        self,
        kind: Kind,
        records: NDArray[Any],
        counts: NDArray[np.uint32],
        indices: NDArray[np.uint32],
    ) -> None:
        origin = self._origin_for(records)
        stream = self._stream(kind, records.dtype)
        if stream.wide:
            data = records.astype(np.float64, copy=False)
        else:
            with np.errstate(over="ignore"):  # what becomes infinite is refused with its index
                data = _relative(kind, records, origin).astype(np.float32, copy=False)
        stream.append(data, counts, indices, origin, self._extent)

    def _origin_for(self, records: NDArray[Any]) -> Vector:
        """The store's origin, which the first block decides."""
        if self._origin is None:
            if records.dtype == np.float32 or self._dtype == np.float32 or len(records) == 0:
                self._origin = (0.0, 0.0, 0.0)
            else:
                center = records[:, :3].mean(axis=0)
                self._origin = _triple("center of the first block", center)
        return self._origin

    def _stream(self, kind: Kind, dtype: np.dtype[Any]) -> StreamWriter:
        if kind not in self._streams:
            wide = dtype != np.float32 or any(self._origin or ())
            if self._dtype is not None:
                wide = self._dtype == np.float64
            folder = self._aside / "0" / kind.label
            self._streams[kind] = StreamWriter(folder, 0, kind, bool(wide))
        stream = self._streams[kind]
        if not stream.wide and self._dtype is None and dtype != np.float32:
            raise SceneError(
                f"{kind.label}: found a block of {dtype}, expected float32 as in the first block"
            )
        return stream

    def _material_indices(self, materials: ArrayLike | None, n: int) -> NDArray[np.uint32]:
        if materials is None:
            return np.full(n, self.material(Material()), np.uint32)
        given = np.asarray(materials)
        indices = np.broadcast_to(given, (n,)) if given.ndim == 0 else given
        if indices.shape != (n,) or indices.dtype.kind not in "iu":
            raise SceneError(
                f"materials: found {indices.dtype} of shape {indices.shape}, "
                f"expected one integer or ({n},) of them"
            )
        if n and (int(indices.min()) < 0 or int(indices.max()) >= self._materials):
            raise SceneError(
                f"materials: found index {int(indices.max())}, "
                f"expected 0 to {self._materials - 1}: add materials first"
            )
        return indices.astype(np.uint32, copy=False)

    def close(self) -> Store:
        """Complete the store and give it its name; returns it, opened."""
        try:
            header = self._header()
            with FileWriter(self._aside / HEADER) as file:
                file.write(header_text(header).encode())
            self._sync_folders()
            self._rename()
        except BaseException:
            self.abandon()
            raise
        degenerate = sum(s.degenerate for s in self._streams.values())
        if degenerate:
            log.warning(
                "%s: %d degenerate objects (no length, no area) are kept and never hit",
                self.path,
                degenerate,
            )
        return open_store(self.path)

    def _header(self) -> dict[str, Any]:
        streams = [self._streams[kind].close() for kind in sorted(self._streams)]
        self._palette.close()
        outliers, grid_bounds = self._extent.outliers()
        group = {"streams": streams, "grid_bounds": bounds_to(grid_bounds), "outliers": outliers}
        return {
            "magic": MAGIC,
            "version": VERSION,
            "origin": self._origin or (0.0, 0.0, 0.0),
            "bounds": bounds_to(self._extent.bounds),
            "groups": [group],
            "camera": None if self._camera is None else asdict(self._camera),
            "lights": self._lights,
            "background": self._background,
            "palette": {"bytes": self._palette.bytes, "crc32": self._palette.checksum},
        }

    def _sync_folders(self) -> None:
        for folder, _, _ in os.walk(self._aside):
            sync_folder(Path(folder))

    def _rename(self) -> None:
        """Take the name; a store that had it steps aside first, and goes when all is well."""
        old = self._aside.with_suffix(".old")
        try:
            if self.path.exists():
                self.path.rename(old)
            self._aside.rename(self.path)
            sync_folder(self.path.parent)
        except OSError as error:
            if old.exists() and not self.path.exists():
                old.rename(self.path)
            raise refused(self.path, 0, error, "renaming to it") from error
        shutil.rmtree(old, ignore_errors=True)

    def abandon(self) -> None:
        """Give up: remove everything written so far."""
        for stream in self._streams.values():
            stream.abandon()
        self._palette.abandon()
        shutil.rmtree(self._aside, ignore_errors=True)

    def __enter__(self) -> SceneWriter:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        if kind is None:
            self.close()
        else:
            self.abandon()


def sync_folder(folder: Path) -> None:
    """Make a folder's entries durable, where the system can (not every one opens folders)."""
    with contextlib.suppress(PermissionError, IsADirectoryError):
        fd = os.open(folder, os.O_RDONLY)
        try:
            os.fsync(fd)
        finally:
            os.close(fd)


def _triple(name: str, value: ArrayLike) -> Vector:
    array = np.asarray(value, np.float64)
    if array.shape != (3,) or not np.isfinite(array).all():
        raise SceneError(f"{name}: found {value!r:.80}, expected three finite numbers")
    return (float(array[0]), float(array[1]), float(array[2]))


def _rows(name: str, value: ArrayLike, row: Sequence[int]) -> tuple[NDArray[Any], int]:
    array = np.asarray(value)
    if array.dtype != np.float32:
        array = array.astype(np.float64, copy=False)
    if array.shape[1:] != tuple(row) or array.ndim != len(row) + 1:
        expected = ", ".join(str(r) for r in ("n", *row))
        raise SceneError(f"{name}: found shape {array.shape}, expected ({expected})")
    return array, len(array)


def _column(name: str, value: ArrayLike, n: int, dtype: np.dtype[Any]) -> NDArray[Any]:
    array = np.asarray(value, dtype)
    if array.ndim == 0:
        array = np.full(n, array)
    if array.shape != (n,):
        raise SceneError(f"{name}: found shape {array.shape}, expected ({n},)")
    return array[:, None]


def _relative(kind: Kind, records: NDArray[Any], origin: Iterable[float]) -> NDArray[Any]:
    """Positions less the origin: the columns of a record that are positions."""
    if not any(origin):
        return records
    shifted = records.astype(np.float64)
    starts = {Kind.SPHERE: (0,), Kind.CONE: (0, 4), Kind.POLYGON: (0,)}.get(kind, (0, 3, 6))
    for start in starts:
        shifted[:, start : start + 3] -= np.asarray(origin)
    return shifted
