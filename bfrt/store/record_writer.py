"""Records into groups: blocks of objects, laid out as on disk, with the materials they name.

A block is checked, prepared, which any thread may do, and added to its group in the order of the
objects. An error in a block ends the store: half a block is never kept.
"""

from __future__ import annotations

import contextlib
import functools
import operator
from collections.abc import Iterator, Mapping
from dataclasses import asdict
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from bfrt.errors import SettingError
from bfrt.ids import MOST_GROUPS
from bfrt.progress import DoneReport
from bfrt.records import Kind
from bfrt.refusals import in_memory
from bfrt.store.atomic_folder import AtomicFolder
from bfrt.store.columns import Prepared, prepare
from bfrt.store.coordinates import Coordinates
from bfrt.store.extent import Bounds, check_extent
from bfrt.store.given import records_of, vertices_of
from bfrt.store.group import GroupWriter
from bfrt.store.making import Making
from bfrt.store.model import Material, Vector
from bfrt.store.ordering.memory import check_memory, least_memory
from bfrt.store.palette import PaletteWriter, SavedPalette, record_of
from bfrt.store.store import PALETTE, bounds_to
from bfrt.store.written import WrittenGroup, make_all
from bfrt.streams.atomic_write import sync_folder

#: Objects whose boxes are worked out at once: what bounds memory beside the caller's block.
BOXES_AT_ONCE = 65536


class SavedRecords(NamedTuple):
    """Holds what a writer has in memory when all groups it has begun are complete.

    Attributes
    ----------
    origin : tuple of 3 float, optional
        Where it is decided.
    palette : SavedPalette
    groups : list of dict
        The facts of each (`WrittenGroup.facts`).
    """

    origin: Vector | None
    palette: SavedPalette
    groups: list[dict[str, Any]]


class RecordWriter:
    """Writes the groups and the palette of a store.

    Parameters
    ----------
    folder : AtomicFolder
        The store's folder, which is created.
    coordinates : Coordinates
        How coordinates are stored.
    making : Making
        How groups are made.
    saved : SavedRecords, optional
        What to go on from; the files are in the folder.
    """

    def __init__(
        self, folder: AtomicFolder, coordinates: Coordinates, making: Making,
        saved: SavedRecords | None = None,
    ) -> None:  # fmt: skip
        self._folder = folder
        self._coordinates = coordinates
        self._making = making
        self._groups: list[GroupWriter | WrittenGroup] = []
        self._open = True
        try:
            folder.create()
            for number, facts in enumerate(saved.groups if saved else ()):
                path = folder.aside / str(number)
                self._groups.append(WrittenGroup.restored(path, number, making, facts))
            if not self._groups:
                self._group(0)
            palette = saved.palette if saved else None
            self._palette = PaletteWriter(folder.aside / PALETTE, folder.durable, palette)
        except BaseException:
            folder.abandon()
            raise

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
        BudgetError
            If the budget is below the least with which they can be brought into order.
        """
        self._group(0).expect(counts, surface)
        if self._making.order != "given":
            wide = self._coordinates.always_wide
            leasts = [least_memory(kind, count, wide=wide) for kind, count in counts.items()]
            check_memory(max(leasts, default=0), self._making.memory, str(self._folder.path))

    def propose_origin(self, origin: Vector) -> None:
        """Have coordinates be relative to a point of the world, if nothing has decided that."""
        self._coordinates.propose_origin(origin)

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
        index = self._palette.find(material)
        if index is not None:
            return index
        record = record_of(material)
        with self._writing():
            return self._palette.add(material, record)

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
        records = records_of(kind, records)
        indices = self._material_indices(materials, len(records))
        with self._writing():
            for first in range(0, len(records), BOXES_AT_ONCE):
                some = slice(first, first + BOXES_AT_ONCE)
                own, part = records[some].copy(), indices[some]
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
        materials, group
            As for `spheres`.

        Raises
        ------
        SceneError, SettingError, DiskFullError, StreamError
            As for `polygons`.
        """
        vertices = vertices_of(vertices, counts)
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
        origin = self._coordinates.decide_origin(records)
        streams = self._group(group).streams if group < len(self._groups) else {}
        stream_wide = streams[kind].wide if kind in streams else None
        data = self._coordinates.stored(kind, records, stream_wide)
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
        """Return a group's writer, made if the group is new.

        Raises
        ------
        SettingError
            If the group is complete.
        """
        if number == len(self._groups):
            path = self._folder.aside / str(number)
            made = GroupWriter(path, number, self._making)
            self._groups.append(made)
        writer = self._groups[number]
        if isinstance(writer, WrittenGroup):
            raise SettingError(f"group: found {number}, which is complete, expected a later one")
        return writer

    def _material_indices(self, materials: ArrayLike | None, n: int) -> NDArray[np.uint32]:
        """Return the material of each of n objects; None is a plain one for all."""
        if materials is None:
            return np.full(n, self.material(Material()), np.uint32)
        return self._palette.indices_of(materials, n)

    def begin_group(self, number: int) -> None:
        """Begin a group, which may stay empty: the next; `SettingError` for others."""
        self._check_group(number)
        self._group(number)

    def complete_group(self, number: int) -> None:
        """Complete the files of a group, if it is begun: it gets no more objects."""
        group = self._groups[number] if number < len(self._groups) else None
        if isinstance(group, GroupWriter):
            with self._writing():
                self._groups[number] = group.close(self._coordinates.origin)

    def saved(self) -> SavedRecords:
        """Return what brings a writer back to here, when all groups so far are complete.

        All files are on the disk then.
        """
        palette = self._palette.saved()
        for group in self._written:
            group.sync()
        sync_folder(self._folder.aside)
        groups = [group.facts for group in self._written]
        return SavedRecords(self._coordinates.decided, palette, groups)

    @property
    def _written(self) -> list[WrittenGroup]:
        """Return the groups that are complete."""
        return [group for group in self._groups if isinstance(group, WrittenGroup)]

    @property
    def hierarchy_seconds(self) -> float:
        """Return what levels and order have taken."""
        return sum(group.hierarchy_seconds for group in self._written)

    def _may_settle(self, last: bool) -> bool:
        """Tell whether files as given may go, now that there are those in order."""
        return True

    def _close(self, progress: DoneReport | None) -> dict[str, Any]:
        """Complete all files of groups and palette; return what the header says of them."""
        origin = self._coordinates.origin
        for number in range(len(self._groups)):
            self.complete_group(number)
        self._palette.forget()
        for group in self._written:
            group.check_memory(origin, str(self._folder.path))
        make_all(self._written, origin, progress, self._may_settle)
        groups = [group.header() for group in self._written]
        palette = self._palette.close()
        bounds = functools.reduce(Bounds.union, [group.bounds for group in self._written])
        check_extent(bounds, origin)
        return {
            "origin": origin,
            "bounds": bounds_to(bounds),
            "groups": groups,
            "palette": palette,
            "hierarchy": asdict(self._making.hierarchy),
        }

    def _check_open(self) -> None:
        if not self._open:
            raise SettingError(f"{self._folder.path}: the writer is closed, expected no more calls")

    @contextlib.contextmanager
    def _writing(self) -> Iterator[None]:
        """Give the store up if the block does not end well."""
        self._check_open()
        try:
            with in_memory(f"{self._folder.path}: writing"):
                yield
        except BaseException:
            self.abandon()
            raise

    def abandon(self) -> None:
        """Give up: remove everything written so far."""
        self._open = False
        for group in self._groups:
            if isinstance(group, GroupWriter):
                group.abandon()
        self._palette.abandon()
        self._folder.abandon()
