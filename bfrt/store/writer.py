"""SceneWriter: blocks of NumPy arrays in, a scene store out.

Everything is written under a temporary name, made durable and renamed at the end, so that what
opens is whole. Blocks pass through once: geometry as given, boxes and materials beside it.
"""

from __future__ import annotations

import logging
import os
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from bfrt.errors import SceneError, SettingError
from bfrt.memory import default_memory, parse_memory
from bfrt.paths import HEADER, MAGIC, check_names, check_outside, is_there, path_of, without_links
from bfrt.progress import DoneReport
from bfrt.records import Kind
from bfrt.refusals import in_memory
from bfrt.store.atomic_folder import AtomicFolder
from bfrt.store.coordinates import Coordinates
from bfrt.store.given import array_of, column_of, faces_among, floats_of, rows_beside, rows_of
from bfrt.store.header import header_text
from bfrt.store.hierarchy import Hierarchy
from bfrt.store.making import Making, Order, checked_order
from bfrt.store.model import Vector
from bfrt.store.record_writer import RecordWriter
from bfrt.store.store import MADE, VERSION, Store, has_magic, open_store
from bfrt.store.view_writer import ViewWriter
from bfrt.streams.writer import FileWriter

if TYPE_CHECKING:
    from typing import Self  # Python 3.11

log = logging.getLogger(__name__)

#: Faces of a mesh that are made objects at once.
FACES_AT_ONCE = 1 << 17


def check_new_store(path: str | os.PathLike[str]) -> Path:
    """Return the path of a store that may be made, or replaced.

    Raises
    ------
    SettingError
        If it is something else than a store, or in one, or has too long a name.
    """
    given = path_of("store", path)
    target = without_links(given)
    if is_there(target) and not has_magic(target):
        raise SettingError(f"{given}: exists and is no scene store: it is not replaced")
    check_outside(str(given), target.parent)
    check_names(str(given), target)
    return given


class StoreWriter(ViewWriter, RecordWriter):
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
    order : {"given", "spatial", "auto"}
        The order in which objects are stored: as they are given; spatial, in treelets, for
        ``refine="tree"``; or auto, which is spatial (docs/tree.rst). Ids count in the order given,
        always. Until objects are in order they take up to three times the store's room on disk.
    durable : bool
        Whether the store outlives a loss of power once it has its name, which takes a moment.
    memory : str or int, optional
        The budget of the whole process while objects are brought into order: ``"256MiB"`` or bytes.
        By default a quarter of the machine's memory, or of its cgroup's limit. The store is the
        same whatever it is.

    Raises
    ------
    SceneError
        For coordinates that are not finite, shapes that do not fit, materials that do not exist,
        and a scene that is so small, so far from the origin, that float64 cannot tell its parts
        apart.
    DiskFullError, StreamError
        If the system refuses a write; nothing is left behind.
    BudgetError
        From `complete`, if the budget is below the least that works for spatial order, which the
        message names; nothing is left behind.
    SettingError
        If `path` exists and is no store, or is in one, and for calls after the end. An error in a
        block, or an interrupt while one is written, is an end too: half a block is never kept.

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
        order: Order = "auto",
        durable: bool = True,
        memory: str | int | None = None,
    ) -> None:
        self.path = check_new_store(path)
        coordinates = Coordinates(dtype, origin)
        budget = default_memory() if memory is None else parse_memory(memory)
        making = Making(hierarchy or Hierarchy(), checked_order(order), durable, budget)
        ViewWriter.__init__(self)
        RecordWriter.__init__(self, AtomicFolder(self.path, durable), coordinates, making)

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
        materials, group
            As for `spheres`.

        Raises
        ------
        SceneError, SettingError, DiskFullError, StreamError
            As for `spheres`; SceneError for a cone that has radii of both signs, too.
        """
        a, n = rows_of("bases", bases, (3,))
        b = rows_beside("apexes", apexes, (3,), n, "bases")
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
        materials, group
            As for `spheres`.

        Raises
        ------
        SceneError, SettingError, DiskFullError, StreamError
            As for `spheres`.
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
        materials, group
            As for `spheres`.

        Raises
        ------
        SceneError, SettingError, DiskFullError, StreamError
            As for `spheres`.
        """
        v, n = rows_of("vertices", vertices, (3, 3))
        own = rows_beside("normals", normals, (3, 3), n, "vertices")
        records = np.hstack([v.reshape(n, 9), own.reshape(n, 9)])
        self.append(Kind.PATCH, records, materials, group=group)

    def mesh(
        self,
        vertices: ArrayLike,
        faces: ArrayLike,
        normals: ArrayLike | None = None,
        materials: ArrayLike | None = None,
        *,
        group: int = 0,
    ) -> None:
        """Add triangles that share vertices, or patches, where vertices have normals.

        Parameters
        ----------
        vertices : (v, 3) array_like
            World coordinates. Float32 stays float32; all other numbers are taken as float64.
        faces : (n, 3) array_like of int
            The vertices of each triangle, from 0, counterclockwise seen from outside.
        normals : (v, 3) array_like, optional
            The normal at each vertex, of any length, which makes patches. One of zeros is none:
            the others of a face count alone, and where they cancel the face's own.
        materials, group
            As for `spheres`: one for each face.

        Raises
        ------
        SceneError, SettingError, DiskFullError, StreamError
            As for `spheres`; SceneError for a face of a vertex that is not there, too.
        """
        v, n = rows_of("vertices", vertices, (3,))
        corners = faces_among(faces, n)
        indices = self._material_indices(materials, len(corners))
        kind = Kind.TRIANGLE
        if normals is not None:
            v = np.hstack([v, rows_beside("normals", normals, (3,), n, "vertices")])
            kind = Kind.PATCH
        for first in range(0, len(corners), FACES_AT_ONCE):
            part = slice(first, first + FACES_AT_ONCE)
            own = v.take(corners[part], axis=0).reshape(-1, 3, v.shape[1] // 3, 3)
            records = own.swapaxes(1, 2).reshape(len(own), -1)
            self.append(kind, records, indices[part], group=group)

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
        materials, group
            As for `spheres`.

        Raises
        ------
        SceneError, SettingError, DiskFullError, StreamError
            As for `spheres`; SceneError for counts that do not fit, too.
        """
        given = floats_of("vertices", vertices), array_of("counts", counts)
        self.append_polygons(*given, materials, group=group)

    def place(self, origin: Vector, crs: str) -> None:
        """Take where objects are: a point near them, and their reference system, if they have one.

        Parameters
        ----------
        origin : tuple of 3 float
            What coordinates are relative to, if nothing has decided that so far.
        crs : str
            As for `crs`; empty for none.

        Raises
        ------
        SceneError
            As for `crs`.
        """
        self.propose_origin(origin)
        if crs:
            self.crs(crs)

    def complete(self, progress: DoneReport | None = None) -> Store:
        """Complete the store and give it its name.

        Parameters
        ----------
        progress : callable, optional
            Called with a `bfrt.progress.Done` of stage "ordering"; returning False cancels.

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
        BudgetError
            If the budget is below the least for spatial order; nothing is left behind.
        Cancelled
            If `progress` returned False; nothing is left behind.
        """
        self._check_open()
        try:
            with in_memory(f"{self.path}: completing"):
                self._put(HEADER, self._header(progress))
                self._folder.sync()
                made = open_store(self._folder.aside)  # what replaces a store is whole
                self._is_whole()
                with made.folder.closed_on_error():
                    self._folder.take_name()
        except BaseException:
            self.abandon()
            raise
        self._open = False
        degenerate = sum(s.degenerate for s in made.streams)
        if degenerate:
            told = "%s: %d degenerate objects (no length, no area) are kept and never hit"
            log.warning(told, self.path, degenerate)
        return made.moved(self.path)

    def _header(self, progress: DoneReport | None = None) -> dict[str, Any]:
        """Complete all other files; return what the header says."""
        records = self._close(progress)
        local = [name for group in self._written for name in group.local]
        self._put(MADE, {"hierarchy_seconds": self.hierarchy_seconds, "local": local})
        return {
            "magic": MAGIC,
            "version": VERSION,
            **self.view,
            **records,
        }

    def _is_whole(self) -> None:
        """Note that the store has all but its name."""

    def _put(self, name: str, fields: dict[str, Any]) -> None:
        with FileWriter(self._folder.aside / name, self._folder.durable) as file:
            file.write(header_text(fields).encode())

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
