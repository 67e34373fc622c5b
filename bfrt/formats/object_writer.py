"""The way of points, triangles and faces into a sink; objects that are not finite are refused."""

from __future__ import annotations

import logging
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from bfrt.errors import SceneError
from bfrt.formats.casting import cast
from bfrt.formats.colors import Painter
from bfrt.formats.ranges import Blocks
from bfrt.formats.reading import Reading
from bfrt.formats.triangulation import Triangulation
from bfrt.image.color_scale import ColorScale
from bfrt.records import Kind
from bfrt.store.model import Camera, Light, Material, Vector

log = logging.getLogger(__name__)

#: The greatest coordinate: boxes are float32.
LARGEST = float(np.finfo(np.float32).max)


class SceneSink(Protocol):
    """Takes the scene that a reader reads: objects, materials, view and lights.

    The arrays of ``append`` and ``append_polygons`` are the sink's from then on. Objects of a kind
    come in input order, in blocks; blocks of different kinds come as they fill.
    """

    def camera(self, camera: Camera, /) -> object:
        """Take the view; not called for a file without one."""

    def light(self, light: Light, /) -> object:
        """Take one light."""

    def background(self, color: Vector, /) -> object:
        """Take the background color, (0, 0, 0) for a file without one."""

    def place(self, origin: Vector, crs: str, /) -> object:
        """Take where a file's objects are, before the first; not called for a file without it.

        Parameters
        ----------
        origin : tuple of 3 float
            A point near them, world coordinates.
        crs : str
            The reference system of coordinates, empty for none.
        """

    def color_scale(self, scale: ColorScale, /) -> object:
        """Take what the colors of a file's objects say, before the first; not called for others."""

    def material(self, material: Material, /) -> int:
        """Return the palette index of a material, the same for the same material."""

    def append(self, kind: Kind, records: NDArray[Any], materials: NDArray[np.uint32], /) -> object:
        """Take objects of a kind that is not a polygon.

        Parameters
        ----------
        kind : Kind
            Sphere, cone, triangle or patch.
        records : ndarray of float32 or float64, shape (n, 4), (n, 8), (n, 9) or (n, 18)
            Sphere: center, radius. Cone: base, its radius, apex, its radius. Triangle: three
            vertices. Patch: three vertices, three normals.
        materials : ndarray of uint32, shape (n,)
            Palette indices.
        """

    def append_polygons(
        self,
        vertices: NDArray[Any],
        counts: NDArray[np.int64],
        materials: NDArray[np.uint32],
        /,
    ) -> object:
        """Take polygons of four and more vertices.

        Parameters
        ----------
        vertices : ndarray of float32 or float64, shape (m, 3)
            The vertices of all polygons, one polygon after the other.
        counts : ndarray of int64, shape (n,)
            The vertices of each; their sum is m.
        materials : ndarray of uint32, shape (n,)
            Palette indices.
        """


class ObjectWriter:
    """Passes one file's points, triangles and faces on to a sink.

    Parameters
    ----------
    sink : SceneSink
    name : str
        Name of the file, for errors.
    reading : Reading

    Attributes
    ----------
    dropped : int
        Objects that were not finite, too large for float32, or of too few corners.
    """

    def __init__(self, sink: SceneSink, name: str, reading: Reading) -> None:
        self.sink = sink
        self.name = name
        self.reading = reading
        self.dropped = 0
        self._objects = 0
        self._triangulation = Triangulation(name, reading)
        self._plain: int | None = None
        self._painter: Painter | None = None

    def paint_by(self, numbers: Blocks) -> None:
        """Have objects painted by the values they come with: numbers (n,) or colors (n, 3).

        Parameters
        ----------
        numbers : callable
            Yields all of them, block by block, as often as it is called, to find their range; not
            called where that is given, or for colors.
        """
        self._painter = Painter(self.sink, self.reading, numbers, self.name)
        if self._painter.scale is not None:
            self.sink.color_scale(self._painter.scale)

    def spheres(
        self,
        centers: NDArray[Any],
        radii: NDArray[Any],
        values: NDArray[Any] | None = None,
    ) -> None:
        """Add points (n, 3) as spheres of radii (n,)."""
        records = np.hstack([centers, cast(radii[:, None], centers.dtype)])
        self._append(Kind.SPHERE, "point", records, values)

    def triangles(self, records: NDArray[Any], values: NDArray[Any] | None = None) -> None:
        """Add triangles (n, 9)."""
        self._append(Kind.TRIANGLE, "triangle", records, values)

    def _append(
        self, kind: Kind, what: str, records: NDArray[Any], values: NDArray[Any] | None
    ) -> None:
        materials = self._painted(values, len(records))
        if not all_finite(records):
            good = self._accept(finite(records), what, records)
            records, materials = records[good], materials[good]
        self._objects += len(records)
        if len(records):
            self.sink.append(kind, records, materials)

    def faces(
        self,
        corners: NDArray[Any],
        counts: NDArray[np.uint32],
        values: NDArray[Any] | None = None,
        own: NDArray[np.uint32] | None = None,
        normals: NDArray[Any] | None = None,
    ) -> None:
        """Add faces, as triangles, as polygons or, where all corners have normals, as patches.

        Parameters
        ----------
        corners : (m, 3) ndarray
            The corners of all.
        counts : (n,) uint32
            How many each has.
        values : (n,) or (n, 3) ndarray, optional
            What paints each.
        own : (n,) uint32, optional
            The materials of those that are not painted.
        normals : (m, 3) ndarray, optional
            The normal at each corner, zeros where there is none.
        """
        if normals is not None:
            corners = np.hstack([corners, cast(normals, corners.dtype)])
        materials = self._painted(values, len(counts), own)
        first = self._objects + self.dropped
        numbers = np.arange(first, first + len(counts))
        if not all_finite(corners) or counts.min(initial=3) < 3:
            good = all_of_each(finite(corners), counts) & (counts >= 3)
            good = self._accept(good, "face", corners, counts)
            corners = corners[np.repeat(good, counts)]
            counts, materials, numbers = counts[good], materials[good], numbers[good]
        self._objects += len(counts)
        if not len(counts):
            return
        if normals is not None:
            smooth = all_of_each(has_length(corners[:, 3:]), counts)
            self._patches(*faces_of(corners, counts, smooth), materials[smooth], numbers[smooth])
            corners, counts = faces_of(corners[:, :3], counts, ~smooth)
            materials, numbers = materials[~smooth], numbers[~smooth]
            if not len(counts):
                return
        corners = np.ascontiguousarray(corners)
        if counts.max() == 3:
            self.sink.append(Kind.TRIANGLE, corners.reshape(-1, 9), materials)
        else:
            self._cut(corners, counts, materials, numbers)

    def _patches(
        self,
        corners: NDArray[Any],
        counts: NDArray[np.uint32],
        materials: NDArray[np.uint32],
        numbers: NDArray[np.int64],
    ) -> None:
        """Add faces as patches: corners (m, 6), each a position and a normal."""
        if not len(counts):
            return
        if counts.max() > 3:
            places = np.ascontiguousarray(corners[:, :3])
            cut = self._triangulation.cut(places, counts, numbers)
            corners, materials = corners[cut.reshape(-1)], np.repeat(materials, counts - 2)
        by_corner = corners.reshape(-1, 3, 2, 3).swapaxes(1, 2)
        self.sink.append(Kind.PATCH, by_corner.reshape(-1, 18), materials)

    def _cut(
        self,
        corners: NDArray[Any],
        counts: NDArray[np.uint32],
        materials: NDArray[np.uint32],
        numbers: NDArray[np.int64],
    ) -> None:
        """Add those faces as triangles that are to be, and the others as polygons."""
        wanted = self._triangulation.wanted(corners, counts)
        if wanted.any():
            part, sizes = faces_of(corners, counts, wanted)
            triangles = self._triangulation.triangles(part, sizes, numbers[wanted])
            self.sink.append(Kind.TRIANGLE, triangles, np.repeat(materials[wanted], sizes - 2))
        if not wanted.all():
            part, sizes = faces_of(corners, counts, ~wanted)
            self.sink.append_polygons(part, sizes.astype(np.int64), materials[~wanted])

    def _painted(
        self, values: NDArray[Any] | None, n: int, own: NDArray[np.uint32] | None = None
    ) -> NDArray[np.uint32]:
        """Return the materials of objects: by their values, their own, or a plain one."""
        if self._painter is not None and values is not None:
            return self._painter.paint(values)
        if own is not None:
            return own
        if self._plain is None:
            self._plain = self.sink.material(Material())
        return np.full(n, self._plain, np.uint32)

    def _accept(
        self,
        good: NDArray[np.bool_],
        what: str,
        numbers: NDArray[Any],
        counts: NDArray[Any] | None = None,
    ) -> NDArray[np.bool_]:
        """Count the objects that are not good, if they may be dropped; return which are.

        Raises
        ------
        SceneError
            If they may not: the first by its number.
        """
        first = self._objects + self.dropped
        if not self.reading.skip_invalid:
            bad = int(np.argmin(good))
            if counts is None:
                row = numbers[bad]
            else:
                start = int(counts[:bad].sum())
                row = numbers[start : start + int(counts[bad])]
                if len(row):  # as far as a corner that is not finite is shown
                    row = row[max(int(np.argmin(finite(row))) - 2, 0) :]
            expected = "numbers" if counts is None else "coordinates of three corners or more"
            most = f", up to {LARGEST:.3g}" if len(row) and too_large(row) else ""
            raise SceneError(
                f"{self.name}: {what} {first + bad}: found {numbers_of(row)}, "
                f"expected finite {expected}{most}"
            )
        self.dropped += int(len(good) - good.sum())
        return good

    def report(self) -> None:
        """Log how many objects were dropped, and how faces were cut."""
        if self.dropped:
            log.warning("%s: %d invalid objects were dropped", self.name, self.dropped)
        if self._painter is not None and self._painter.strange:
            log.warning(
                "%s: %d colors are not from 0 to 1: the nearest that are were taken",
                self.name,
                self._painter.strange,
            )
        self._triangulation.report()


def all_finite(numbers: NDArray[Any]) -> bool:
    """Tell whether all numbers are finite, by least and greatest: with a NaN both are NaN."""
    return not numbers.size or bool(numbers.min() >= -LARGEST and numbers.max() <= LARGEST)


def finite(numbers: NDArray[Any]) -> NDArray[np.bool_]:
    """Tell which rows are finite, as float32 too; a NaN fails every comparison."""
    good: NDArray[np.bool_] = np.all(np.abs(numbers) <= LARGEST, axis=1)
    return good


def too_large(numbers: NDArray[Any]) -> bool:
    """Tell whether all numbers are finite, but not all as float32."""
    return bool(np.isfinite(numbers).all() and np.abs(numbers).max() > LARGEST)


def has_length(normals: NDArray[Any]) -> NDArray[np.bool_]:
    """Tell which normals (n, 3) are not of all zeros."""
    some: NDArray[np.bool_] = np.any(normals != 0, axis=1)
    return some


def all_of_each(good: NDArray[np.bool_], counts: NDArray[Any]) -> NDArray[np.bool_]:
    """Tell for each face whether all its corners are good; a face without corners is good."""
    bad_before = np.concatenate([[0], np.cumsum(~good)])
    ends = np.cumsum(counts, dtype=np.int64)
    none: NDArray[np.bool_] = bad_before[ends] == bad_before[ends - counts]
    return none


def faces_of(
    corners: NDArray[Any], counts: NDArray[np.uint32], some: NDArray[np.bool_]
) -> tuple[NDArray[Any], NDArray[np.uint32]]:
    """Return the corners and the counts of the faces chosen."""
    if some.all():
        return corners, counts
    return corners[np.repeat(some, counts)], counts[some]


def numbers_of(row: NDArray[Any]) -> str:
    """Return numbers in words, for an error."""
    return " ".join(f"{float(x):g}" for x in row.reshape(-1)[:9]) or "nothing"
