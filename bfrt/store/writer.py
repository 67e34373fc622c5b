"""SceneWriter: blocks of NumPy arrays in, a scene store out.

Everything is written under a temporary name, made durable and renamed at the end, so that what
opens is whole. Blocks pass through once: geometry as given, boxes and materials beside it.
"""

from __future__ import annotations

import contextlib
import functools
import logging
import operator
import os
import secrets
import shutil
from collections import OrderedDict
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import asdict
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from bfrt.errors import SceneError, SettingError
from bfrt.records import KIND_BITS, MATERIAL, SCALARS, STREAM_BITS, Kind
from bfrt.store.columns import Prepared, prepare
from bfrt.store.extent import Bounds, check_extent
from bfrt.store.given import array_of, column_of, floats_of, rows_of, triple_of
from bfrt.store.group import GroupWriter
from bfrt.store.header import header_text
from bfrt.store.hierarchy import Hierarchy
from bfrt.store.model import Camera, Light, Material, Vector
from bfrt.store.store import (
    HEADER,
    MADE,
    MAGIC,
    PALETTE,
    VERSION,
    Store,
    bounds_to,
    has_magic,
    open_store,
)
from bfrt.streams.atomic_write import refused, sync_folder
from bfrt.streams.writer import FileWriter

if TYPE_CHECKING:
    from typing import Self  # Python 3.11

log = logging.getLogger(__name__)

#: Distinct materials that are remembered, so that a repeated one is stored once.
REMEMBERED = 65536

#: Groups of a store: their streams have numbers of 16 bits.
MOST_GROUPS = 1 << STREAM_BITS - KIND_BITS

#: Objects whose boxes are worked out at once: what bounds memory beside the caller's block.
BOXES_AT_ONCE = 65536


class StoreWriter:
    """Writes a scene store, block by block.

    Parameters
    ----------
    path : path-like
        The store to make. A store that is there is replaced when this one is complete; anything
        else that is there is refused.
    dtype : {None, "float32", "float64"}
        The type that geometry is stored as. None keeps float32 as it is and all else as float64.
    origin : (3,) array_like, optional
        The point that boxes and float32 coordinates are relative to, world coordinates. By default
        zero if the first block is float32, and the center of the first block if it is float64.
    hierarchy : Hierarchy, optional
        Settings of the box hierarchy, which is made when all objects are written. By default
        `Hierarchy`'s.
    durable : bool
        Whether the store outlives a loss of power once it has its name, which takes a moment; not
        needed for a store that is removed after a render.

    Raises
    ------
    SceneError
        For coordinates that are not finite, shapes that do not fit, materials that do not exist,
        and a scene that is so small, so far from the origin, that float64 cannot tell its parts
        apart.
    DiskFullError, StreamError
        If the system refuses a write; nothing is left behind.
    SettingError
        If `path` exists and is no store, and for calls after the end. An error in a block, or an
        interrupt while one is written, is an end too: half a block is never kept.

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
        hierarchy: Hierarchy | None = None,
        durable: bool = True,
    ) -> None:
        self.path = Path(path)
        if dtype is not None and np.dtype(dtype) not in (np.float32, np.float64):
            raise SettingError(f"dtype: found {dtype!r}, expected float32, float64 or None")
        self._dtype = None if dtype is None else np.dtype(dtype)
        self._origin = None if origin is None else triple_of("origin", origin)
        self._hierarchy = hierarchy or Hierarchy()
        self._durable = durable
        self._groups: list[GroupWriter] = []
        self._camera: Camera | None = None
        self._lights: list[Light] = []
        self._background: Vector = (0.0, 0.0, 0.0)
        self._remembered: OrderedDict[Material, int] = OrderedDict()
        self._materials = 0
        # A link is followed: its target is replaced, not the link.
        self._target = Path(os.path.realpath(path))
        if os.path.lexists(self._target) and not has_magic(self._target):
            raise SettingError(f"{self.path}: exists and is no scene store: it is not replaced")
        name = f".{self._target.name[:40]}.{secrets.token_hex(8)}.part"
        self._aside = self._target.with_name(name)
        self._open = True
        try:
            self._aside.mkdir(parents=True)
            self._group(0)
            self._palette = FileWriter(self._aside / PALETTE, durable)
        except BaseException as error:
            shutil.rmtree(self._aside, ignore_errors=True)
            if isinstance(error, OSError):
                raise refused(self._aside, 0, error, "creating") from error
            raise

    def camera(self, camera: Camera) -> None:
        """Set the view that is rendered where the caller gives no other.

        Parameters
        ----------
        camera : Camera
            In world coordinates. A second call replaces the first.

        Raises
        ------
        SceneError
            If a vector is not three finite numbers, or a value is out of range.
        """
        self._camera = Camera(
            triple_of("eye", camera.eye),
            triple_of("at", camera.at),
            triple_of("up", camera.up),
            float(camera.angle),
            float(camera.hither),
            (int(camera.resolution[0]), int(camera.resolution[1])),
        )

    def light(self, light: Light) -> None:
        """Add a point light.

        Parameters
        ----------
        light : Light
            Position in world coordinates, and relative color.

        Raises
        ------
        SceneError
            If position or color are not three finite numbers.
        """
        self._lights.append(
            Light(triple_of("light", light.position), triple_of("color of a light", light.color))
        )

    def background(self, color: Vector) -> None:
        """Set the color of rays that meet nothing.

        Parameters
        ----------
        color : (3,) array_like
            Linear RGB. A scene without a call has black, (0, 0, 0).

        Raises
        ------
        SceneError
            If the color is not three finite numbers.
        """
        self._background = triple_of("background", color)

    def expect(self, counts: Mapping[Kind, int], surface: float) -> None:
        """Announce the objects of group 0, before the first of them is added.

        The first level of the hierarchy is then made as objects come, without a second pass over
        their boxes.

        Parameters
        ----------
        counts : mapping of Kind to int
            Number of objects of each kind that will be added. A store that gets other counts is
            refused at its end.
        surface : float
            The surface of the grid, about, in square world units; it decides how many boxes are
            merged into one.

        Raises
        ------
        SettingError
            If objects were added already.
        """
        self._groups[0].expect(counts, surface)

    def material(self, material: Material) -> int:
        """Add a material to the palette; return its index.

        Parameters
        ----------
        material : Material
            One that equals a recent one (of the last 65536 different ones) gets its index again.

        Returns
        -------
        int
            The index that objects refer to, from 0.

        Raises
        ------
        SceneError
            If a number is negative, or not finite as float32.
        """
        index = self._remembered.get(material)
        if index is not None:
            return index
        with np.errstate(over="ignore"):  # infinity is refused
            row = np.array([(*material.color, *material[1:])], MATERIAL)
        numbers = row.view("<f4")
        if not np.isfinite(numbers).all() or (numbers < 0).any():
            raise SceneError(f"material: found {material}, expected finite numbers, none negative")
        with self._writing():
            self._palette.write(row.view(np.uint8))
        index = self._materials
        self._materials += 1
        self._remembered[material] = index
        if len(self._remembered) > REMEMBERED:
            self._remembered.popitem(last=False)
        return index

    def spheres(
        self,
        centers: ArrayLike,
        radii: ArrayLike,
        materials: ArrayLike | None = None,
        *,
        group: int = 0,
    ) -> None:
        """Add spheres.

        Parameters
        ----------
        centers : (n, 3) array_like
            World coordinates. Float32 stays float32; all other numbers are taken as float64.
        radii : float or (n,) array_like
            World units, converted to the type of `centers`. A negative radius turns the normal
            inwards; a sphere of radius 0 is kept and never hit.
        materials : int or (n,) array_like of int, optional
            Indices that `material` returned. By default a plain `Material`.
        group : int
            The group that the objects belong to; each group has a grid of its own. Groups are
            numbered from 0 without gaps: an old one, or the next.

        Raises
        ------
        SceneError
            If shapes do not fit, a number is not finite, or a material does not exist.
        SettingError
            If `group` is beyond the next, or the writer is closed.
        DiskFullError, StreamError
            If the system refuses a write.
        """
        c, n = rows_of("centers", centers, (3,))
        records = np.hstack([c, column_of("radii", radii, n, c.dtype)])
        self.append(Kind.SPHERE, records, materials, group=group)

    def cones(
        self,
        bases: ArrayLike,
        base_radii: ArrayLike,
        apexes: ArrayLike,
        apex_radii: ArrayLike,
        materials: ArrayLike | None = None,
        *,
        group: int = 0,
    ) -> None:
        """Add cones and cylinders without caps.

        Parameters
        ----------
        bases, apexes : (n, 3) array_like
            The centers of both ends, world coordinates. If both are float32 they stay so; else
            both are taken as float64.
        base_radii, apex_radii : float or (n,) array_like
            The radii at the ends, world units. Equal radii make a cylinder, and 0 a tip. Negative
            radii turn the normals inwards; the two of a cone have one sign.
        materials : int or (n,) array_like of int, optional
            Indices that `material` returned. By default a plain `Material`.
        group : int
            The group that the objects belong to, as for `spheres`.

        Raises
        ------
        SceneError
            If shapes do not fit, a cone has radii of both signs, a number is not finite, or a
            material does not exist.
        SettingError
            If `group` is beyond the next, or the writer is closed.
        DiskFullError, StreamError
            If the system refuses a write.
        """
        a, n = rows_of("bases", bases, (3,))
        b, m = rows_of("apexes", apexes, (3,))
        if n != m:
            raise SceneError(f"apexes: found {m} rows, expected {n}, as many as bases")
        dtype = np.result_type(a, b)
        ra = column_of("base_radii", base_radii, n, dtype)
        rb = column_of("apex_radii", apex_radii, n, dtype)
        if (ra * rb < 0).any():
            raise SceneError("cones: found radii of both signs in one cone, expected one sign")
        self.append(Kind.CONE, np.hstack([a, ra, b, rb]), materials, group=group)

    def triangles(
        self, vertices: ArrayLike, materials: ArrayLike | None = None, *, group: int = 0
    ) -> None:
        """Add triangles.

        Parameters
        ----------
        vertices : (n, 3, 3) array_like
            Three corners of each, world coordinates, counterclockwise seen from outside. Float32
            stays float32; all other numbers are taken as float64.
        materials : int or (n,) array_like of int, optional
            Indices that `material` returned. By default a plain `Material`.
        group : int
            The group that the objects belong to, as for `spheres`.

        Raises
        ------
        SceneError
            If shapes do not fit, a number is not finite, or a material does not exist.
        SettingError
            If `group` is beyond the next, or the writer is closed.
        DiskFullError, StreamError
            If the system refuses a write.
        """
        v, n = rows_of("vertices", vertices, (3, 3))
        self.append(Kind.TRIANGLE, v.reshape(n, 9), materials, group=group)

    def patches(
        self,
        vertices: ArrayLike,
        normals: ArrayLike,
        materials: ArrayLike | None = None,
        *,
        group: int = 0,
    ) -> None:
        """Add patches: triangles with a normal at each corner, for smooth shading.

        Parameters
        ----------
        vertices : (n, 3, 3) array_like
            Three corners of each, world coordinates, counterclockwise seen from outside.
        normals : (n, 3, 3) array_like
            The normal at each corner, of any length. Both stay float32 if both are; else both are
            taken as float64.
        materials : int or (n,) array_like of int, optional
            Indices that `material` returned. By default a plain `Material`.
        group : int
            The group that the objects belong to, as for `spheres`.

        Raises
        ------
        SceneError
            If shapes do not fit, a number is not finite, or a material does not exist.
        SettingError
            If `group` is beyond the next, or the writer is closed.
        DiskFullError, StreamError
            If the system refuses a write.
        """
        v, n = rows_of("vertices", vertices, (3, 3))
        normal, m = rows_of("normals", normals, (3, 3))
        if n != m:
            raise SceneError(f"normals: found {m} rows, expected {n}, as many as vertices")
        records = np.hstack([v.reshape(n, 9), normal.reshape(n, 9)])
        self.append(Kind.PATCH, records, materials, group=group)

    def polygons(
        self,
        vertices: ArrayLike,
        counts: ArrayLike,
        materials: ArrayLike | None = None,
        *,
        group: int = 0,
    ) -> None:
        """Add polygons, convex or concave.

        A polygon of three vertices is stored as a triangle and numbered among triangles. A polygon
        is met in the plane that fits its vertices.

        Parameters
        ----------
        vertices : (m, 3) array_like
            The vertices of all polygons, one polygon after another, world coordinates,
            counterclockwise seen from outside. Float32 stays float32; all other numbers are taken
            as float64.
        counts : (n,) array_like of int
            Number of vertices of each polygon, 3 or more; they add up to m.
        materials : int or (n,) array_like of int, optional
            Indices that `material` returned. By default a plain `Material`.
        group : int
            The group that the objects belong to, as for `spheres`.

        Raises
        ------
        SceneError
            If shapes or counts do not fit, a number is not finite, or a material does not exist.
        SettingError
            If `group` is beyond the next, or the writer is closed.
        DiskFullError, StreamError
            If the system refuses a write.
        """
        given = floats_of("vertices", vertices), array_of("counts", counts)
        self.append_polygons(*given, materials, group=group)

    def append(
        self,
        kind: Kind,
        records: NDArray[Any],
        materials: ArrayLike | None = None,
        *,
        group: int = 0,
    ) -> None:
        """Add records of one kind, laid out as on disk.

        Parameters
        ----------
        kind : Kind
            Any kind but polygons.
        records : (n, scalars) float32 or float64
            One object a row, `bfrt.records.SCALARS` numbers each: center and radius of a sphere;
            base, radius there, apex and radius there of a cone; three corners of a triangle, and
            three normals behind them for a patch. The array is copied.
        materials : int or (n,) array_like of int, optional
            Indices that `material` returned. By default a plain `Material`.
        group : int
            The group that the objects belong to, as for `spheres`.

        Raises
        ------
        SceneError, SettingError, DiskFullError, StreamError
            As for `spheres`.
        """
        records = floats_of(kind.label, records)
        if records.ndim != 2 or records.shape[1] != SCALARS[kind] or kind == Kind.POLYGON:
            raise SceneError(
                f"{kind.label}: found records of shape {records.shape}, "
                f"expected (n, {SCALARS[kind]})"
            )
        indices = self._material_indices(materials, len(records))
        with self._writing():
            for first in range(0, len(records), BOXES_AT_ONCE):
                last = first + BOXES_AT_ONCE
                part = indices[first:last]
                own = records[first:last].copy()
                self.add(self.prepare(kind, own, np.zeros_like(part), part, group))

    def append_polygons(
        self,
        vertices: NDArray[Any],
        counts: NDArray[Any],
        materials: ArrayLike | None = None,
        *,
        group: int = 0,
    ) -> None:
        """Add polygons of vertices (m, 3) and counts (n,), as `polygons` does.

        Parameters
        ----------
        vertices : (m, 3) ndarray
            The vertices of all polygons, one polygon after another.
        counts : (n,) ndarray of int
            Number of vertices of each polygon, 3 or more; they add up to m.
        materials : int or (n,) array_like of int, optional
            Indices that `material` returned. By default a plain `Material`.
        group : int
            The group that the objects belong to, as for `spheres`.

        Raises
        ------
        SceneError, SettingError, DiskFullError, StreamError
            As for `polygons`.
        """
        vertices = floats_of("polygon", vertices)
        if vertices.ndim != 2 or vertices.shape[1] != 3:
            raise SceneError(f"polygon: found vertices of shape {vertices.shape}, expected (m, 3)")
        if counts.ndim != 1 or (len(counts) and counts.dtype.kind not in "iu"):
            raise SceneError(
                f"polygon: found counts of {counts.dtype} and shape {counts.shape}, "
                "expected integers of shape (n,)"
            )
        # No count above the sum, or sums of 64 bits could come round.
        fits = not len(counts) or 3 <= counts.min() <= counts.max() <= len(vertices)
        if not fits or int(counts.sum()) != len(vertices):
            raise SceneError(
                f"polygon: found {len(vertices)} vertices for counts of {counts.sum()} in all, "
                "expected as many, each count 3 or more"
            )
        indices = self._material_indices(materials, len(counts))
        three = counts == 3
        if three.any():
            in_triangle = np.repeat(three, counts)
            triangles = vertices[in_triangle].reshape(-1, 9)
            self.append(Kind.TRIANGLE, triangles, indices[three], group=group)
            vertices, counts, indices = vertices[~in_triangle], counts[~three], indices[~three]
        if len(counts):
            with self._writing():
                own, fours = vertices.copy(), counts.astype(np.uint32)
                self.add(self.prepare(Kind.POLYGON, own, fours, indices, group))

    def prepare(
        self,
        kind: Kind,
        records: NDArray[Any],
        counts: NDArray[np.uint32],
        materials: NDArray[np.uint32],
        group: int = 0,
    ) -> Prepared:
        """Prepare a block for `add`: any thread may do it, in any order.

        Parameters
        ----------
        kind : Kind
            The kind of the objects.
        records : (n, scalars) float32 or float64
            The objects, laid out as on disk; for polygons the vertices (m, 3). The writer keeps the
            array, so that the caller must not change it later.
        counts : (n,) uint32
            Number of vertices of each polygon, 4 or more; not used for other kinds.
        materials : (n,) uint32
            Indices that `material` returned.
        group : int
            The group that the objects belong to, as for `spheres`.

        Returns
        -------
        Prepared
            What `add` takes.

        Raises
        ------
        SettingError
            If `group` is beyond the next.
        """
        self._check_group(group)
        origin = self._origin_for(records)
        wide = self._is_wide(kind, records.dtype, group)
        with np.errstate(over="ignore"):  # infinity is refused
            if not wide:
                records = _relative(kind, records, origin)
            data = np.ascontiguousarray(records, np.float64 if wide else np.float32)
        return prepare(kind, data, counts, materials, origin, group)

    def add(self, block: Prepared) -> None:
        """Write a prepared block: the next objects of its kind.

        Parameters
        ----------
        block : Prepared
            The result of `prepare`.

        Raises
        ------
        SceneError
            If a number is not finite.
        SettingError
            If the writer is closed.
        DiskFullError, StreamError
            If the system refuses a write.
        """
        with self._writing():
            self._group(block.group).add(block)

    def _check_group(self, group: int) -> None:
        """Refuse a group that is neither an old one nor the next: numbers have no gaps."""
        if isinstance(group, bool) or not 0 <= operator.index(group) <= len(self._groups):
            raise SettingError(
                f"group: found {group!r}, expected 0 to {len(self._groups)}: the last is new"
            )
        if group >= MOST_GROUPS:
            raise SettingError(f"group: found {group}, expected fewer than {MOST_GROUPS}")

    def _group(self, number: int) -> GroupWriter:
        """Return a group's writer, made if the group is new."""
        if number == len(self._groups):
            folder = self._aside / str(number)
            folder.mkdir()
            self._groups.append(GroupWriter(folder, number, self._hierarchy, self._durable))
        return self._groups[number]

    def _origin_for(self, records: NDArray[Any]) -> Vector:
        """Return the store's origin, which the first block decides."""
        if self._origin is None:
            self._origin = (0.0, 0.0, 0.0)
            if records.dtype != np.float32:
                with np.errstate(all="ignore"):
                    center = records[:, :3].mean(axis=0, dtype=np.float64)
                if np.isfinite(center).all():  # else the block is about to be refused
                    self._origin = triple_of("center of the first block", center)
        return self._origin

    def _is_wide(self, kind: Kind, dtype: np.dtype[Any], group: int) -> bool:
        """Tell whether a stream is float64, which its first block decides unless `dtype` does."""
        if self._dtype is not None:
            return bool(self._dtype == np.float64)
        narrow = dtype == np.float32
        streams = self._groups[group].streams if group < len(self._groups) else {}
        if kind not in streams:
            return not narrow or any(self._origin or ())
        if not streams[kind].wide and not narrow:
            raise SceneError(
                f"{kind.label}: found a block of {dtype}, expected float32 as in the first block"
            )
        return streams[kind].wide

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
        low, high = (int(indices.min()), int(indices.max())) if n else (0, -1)
        if low < 0 or high >= self._materials:
            raise SceneError(
                f"materials: found index {low if low < 0 else high}, "
                f"expected 0 to {self._materials - 1}: add materials first"
            )
        return indices.astype(np.uint32, copy=False)

    def complete(self) -> Store:
        """Complete the store and give it its name.

        Returns
        -------
        Store
            The new store, opened.

        Raises
        ------
        SceneError
            If the scene is too small for its distance from the origin, or `expect` announced other
            counts.
        SettingError
            If the writer is closed.
        DiskFullError, StreamError
            If the system refuses a write; nothing is left behind.
        """
        self._check_open()
        try:
            self._put(HEADER, self._header())
            for folder, _, _ in os.walk(self._aside) if self._durable else ():
                sync_folder(Path(folder))
            open_store(self._aside)  # what replaces a store is whole
            self._rename()
        except BaseException:
            self.abandon()
            raise
        self._open = False
        degenerate = sum(s.degenerate for g in self._groups for s in g.streams.values())
        if degenerate:
            log.warning(
                "%s: %d degenerate objects (no length, no area) are kept and never hit",
                self.path,
                degenerate,
            )
        return open_store(self.path)

    def _header(self) -> dict[str, Any]:
        origin = self._origin or (0.0, 0.0, 0.0)
        groups = [group.close(origin) for group in self._groups]
        self._palette.close()
        self._put(MADE, {"hierarchy_seconds": sum(g.hierarchy_seconds for g in self._groups)})
        bounds = functools.reduce(Bounds.union, [group.bounds for group in self._groups])
        check_extent(bounds, origin)
        return {
            "magic": MAGIC,
            "version": VERSION,
            "origin": origin,
            "bounds": bounds_to(bounds),
            "groups": groups,
            "camera": None if self._camera is None else asdict(self._camera),
            "lights": self._lights,
            "background": self._background,
            "palette": {"bytes": self._palette.bytes, "crc32": self._palette.checksum},
            "hierarchy": asdict(self._hierarchy),
        }

    def _put(self, name: str, fields: dict[str, Any]) -> None:
        with FileWriter(self._aside / name, self._durable) as file:
            file.write(header_text(fields).encode())

    def _rename(self) -> None:
        """Take the name; a store that had it steps aside first, and goes when all is well."""
        old = self._aside.with_suffix(".old")
        replaces = self._target.exists()
        try:
            if replaces:
                self._target.rename(old)
            self._aside.rename(self._target)
            if self._durable:
                sync_folder(self._target.parent)
        except BaseException as error:
            self._step_back(old, replaces)
            if isinstance(error, OSError):
                raise refused(self.path, 0, error, "renaming to it") from error
            raise
        try:
            if replaces:
                shutil.rmtree(old)
        except OSError as error:
            log.warning("%s: the store that was replaced could not be removed: %s", old, error)

    def _step_back(self, old: Path, replaces: bool) -> None:
        """Undo the renames that were done."""
        renamed = not self._aside.exists() and self._target.exists()
        if renamed and old.exists() == replaces:
            self._target.rename(self._aside)
        if replaces and not self._target.exists():
            old.rename(self._target)

    def _check_open(self) -> None:
        if not self._open:
            raise SettingError(f"{self.path}: the writer is closed, expected no more calls")

    @contextlib.contextmanager
    def _writing(self) -> Iterator[None]:
        """Give the store up if the block does not end well."""
        self._check_open()
        try:
            yield
        except BaseException:
            self.abandon()
            raise

    def abandon(self) -> None:
        """Give up: remove everything written so far."""
        self._open = False
        for group in self._groups:
            group.abandon()
        self._palette.abandon()
        shutil.rmtree(self._aside, ignore_errors=True)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        if kind is not None:
            self.abandon()
        elif self._open:  # not closed in the block already
            self.complete()


def _relative(kind: Kind, records: NDArray[Any], origin: Iterable[float]) -> NDArray[Any]:
    """Subtract the origin from the columns of a record that are positions."""
    if not any(origin):
        return records
    shifted = records.astype(np.float64)
    starts = {Kind.SPHERE: (0,), Kind.CONE: (0, 4), Kind.POLYGON: (0,)}.get(kind, (0, 3, 6))
    for start in starts:
        shifted[:, start : start + 3] -= np.asarray(origin)
    return shifted
