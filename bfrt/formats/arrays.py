"""Scenes made of arrays with names: spheres, triangles, meshes, and points with columns beside.

A format that keeps arrays (.npy, .npz, HDF5) gives each as an `Array`, of which rows are read
forwards; what they mean is told by their names and shapes, here:

=========================  =========================================================
names                      what they are
=========================  =========================================================
``vertices``, ``faces``    (v, 3) and (f, k) whole numbers from 0: a mesh; ``triangles`` of
                           whole numbers (f, 3) are its faces too
``normals``                (v, 3) beside vertices, for ``smooth``
``triangles``              (n, 3, 3) or (n, 9)
``spheres``                (n, 4): x y z and the radius
`CENTERS`, ``radii``       (n, 3) and (n,): spheres, or points where there are no radii
``x``, ``y``, ``z``        (n,) each: the same, in three columns
any other                  (n,) columns to color by; ``colors`` (n, 3) for ``rgb``, or
                           ``red``, ``green``, ``blue``
=========================  =========================================================

A name's last part counts, behind the last slash: the part before is a folder, as of HDF5's groups
or of the fields of records. What belongs together is in one folder.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bfrt.errors import SettingError
from bfrt.formats.casting import cast
from bfrt.formats.colors import full_of
from bfrt.formats.mesh import Faces, write_mesh
from bfrt.formats.naming import (
    NORMAL_NAMES,
    RADII,
    beside,
    colors_in,
    is_column,
    is_rows,
    joined,
    mesh_in,
    named,
    positions_in,
    positions_named,
    triangles_in,
)
from bfrt.formats.object_writer import ObjectWriter
from bfrt.formats.points import POINTS_AT_ONCE, PointBlock, write_points
from bfrt.formats.reading import PAINTED, POINTS, RGB, Reading
from bfrt.formats.table import Array, Arrays, Rows, floats, level, wrong

#: Bytes of an array's rows that are read at once, unless one row has more.
BLOCK_BYTES = 8 << 20


def write_arrays(file: str, arrays: Arrays, writer: ObjectWriter) -> None:
    """Write a scene made of named arrays: triangles, a mesh, or points.

    Raises
    ------
    SceneError
        If no names or shapes are known.
    SettingError
        If a setting names an array that is missing.
    """
    reading = writer.reading
    mesh = mesh_in(file, arrays, reading.positions)
    points = reading.positions is not None and not mesh
    if mesh:
        reading.uses.known.add("positions")
        write_mesh(ArrayMesh(file, arrays, reading, *mesh), writer)
    elif not points and (triangles := triangles_in(file, arrays)):
        write_triangles(arrays, triangles[0], writer)
    else:
        found = ArrayPoints(file, arrays, reading)
        reading.refuse_all_but(file, "positions", *POINTS)
        write_points(found, writer)


def write_triangles(arrays: Arrays, key: str, writer: ObjectWriter) -> None:
    """Write triangles (n, 3, 3) or (n, 9), painted by a column of one value a triangle."""
    reading, triangles = writer.reading, arrays[key]
    reading.refuse_all_but(writer.name, *PAINTED)
    if triangles.shape[1:] not in ((3, 3), (9,)):
        raise wrong(triangles, "(n, 3, 3) or (n, 9)")
    column = painting(arrays, reading, writer.name, key, triangles.shape[0])
    if column is not None:
        writer.paint_by(lambda: numbers(column))
    dtype = floats(triangles)
    for block, values in together(triangles, column):
        writer.triangles(cast(block.reshape(len(block), 9), dtype), values)


class ArrayPoints:
    """Reads positions with columns beside them: a `bfrt.formats.points.Points`."""

    def __init__(self, file: str, arrays: Arrays, reading: Reading) -> None:
        self.name = file
        keys = self._find_centers(arrays, reading)
        self._centers = joined(arrays, keys)
        self._has_radii = self._centers.shape[1:] == (4,) and reading.radius is None
        if self._centers.shape[1:] not in ((3,), (4,)):
            raise wrong(arrays[keys[0]], "(n, 3), or (n, 4) with radii")
        count = self._centers.shape[0]
        self._radii = self._find_radii(arrays, reading, keys[0], count)
        self._values = painting(arrays, reading, file, keys[0], count)
        self.painted = self._values is not None

    def _find_centers(self, arrays: Arrays, reading: Reading) -> list[str]:
        if reading.positions is None:
            return positions_in(self.name, arrays)
        return positions_named(self.name, arrays, reading.positions)

    def _find_radii(
        self, arrays: Arrays, reading: Reading, centers: str, count: int
    ) -> Array | None:
        """Find the array of radii; None where positions have a fourth column or one is given."""
        if reading.radius_column is not None:
            key = named(arrays, reading.radius_column, self.name, "radius", centers)
            return column_of(arrays[key], count)
        if reading.radius is None and not self._has_radii:
            for key in beside(arrays, RADII, centers):
                return column_of(arrays[key], count)
        return None

    def blocks(self) -> Iterator[PointBlock]:
        dtype = floats(self._centers)
        for block, radii, values in together(self._centers, self._radii, self._values):
            positions = cast(block, dtype)
            own = positions[:, 3] if self._has_radii else radii
            yield PointBlock(positions[:, :3], own, values)

    def numbers(self) -> Iterator[NDArray[Any]]:
        return numbers(self._values)


class ArrayMesh:
    """Reads arrays of vertices and faces: a `bfrt.formats.mesh.Mesh`."""

    what = "vertex"
    normals = None

    def __init__(
        self, file: str, arrays: Arrays, reading: Reading, vertices: str, faces: str
    ) -> None:
        self.name = file
        self._vertices, self._faces = arrays[vertices], arrays[faces]
        if self._vertices.shape[1:] != (3,):
            raise wrong(self._vertices, "(n, 3)")
        each = self._faces.shape[1:]
        if len(each) != 1 or not 3 <= each[0] < 1 << 20 or self._faces.dtype.kind not in "iu":
            raise wrong(self._faces, "(n, 3) whole numbers, or as many as faces have corners")
        self.vertices = self._vertices.shape[0]
        self.coordinates = floats(self._vertices)
        counts = (self.vertices, self._faces.shape[0])
        self._column = painting(arrays, reading, file, vertices, *counts)
        self.painted = self._column is not None
        self._normals = self._find_normals(arrays, vertices) if reading.smooth else None
        self.has_normals = bool(beside(arrays, NORMAL_NAMES, vertices))
        self._of_vertices = self.painted and self._rows() == self.vertices
        self.row = self.coordinates
        self.columns = 3
        if self._normals is not None:
            self.columns += 3
            self.row = np.promote_types(self.row, floats(self._normals))
        if self._of_vertices and self._column is not None:
            self.columns += self._column.shape[1] if len(self._column.shape) == 2 else 1
            self.row = np.promote_types(self.row, floats(self._column))

    def _find_normals(self, arrays: Arrays, vertices: str) -> Array | None:
        """Find the normals of the vertices; None if there are none."""
        for key in beside(arrays, NORMAL_NAMES, vertices):
            found = arrays[key]
            if found.shape != (self.vertices, 3):
                raise wrong(found, f"numbers of shape ({self.vertices}, 3)")
            return found
        return None

    def _rows(self) -> int:
        return 0 if self._column is None else self._column.shape[0]

    def vertex_blocks(self) -> Iterator[NDArray[Any]]:
        column = self._column if self._of_vertices else None
        for block, *more in together(self._vertices, self._normals, column):
            parts = (part.reshape(len(block), -1) for part in more if part is not None)
            yield np.hstack([cast(part, self.row) for part in (block, *parts)])

    def face_blocks(self) -> Iterator[Faces]:
        beside = None if self._of_vertices else self._column
        for block, values in together(self._faces, beside):
            counts = np.full(len(block), block.shape[1], np.uint32)
            if block.dtype == np.uint64:  # what 64 signed bits do not hold is no vertex either
                block = np.minimum(block, np.uint64((1 << 63) - 1))
            yield Faces(block.astype(np.int64).reshape(-1), counts, values)

    def numbers(self) -> Iterator[NDArray[Any]]:
        return numbers(self._column)


def painting(arrays: Arrays, reading: Reading, file: str, near: str, *counts: int) -> Rows | None:
    """Find the array that colors are made from, whose length is one of `counts`.

    It is in the folder of the array `near`, or has its whole name.
    """
    if reading.color_by is None:
        return None
    if reading.color_by != RGB:
        return column_of(arrays[named(arrays, reading.color_by, file, "color_by", near)], *counts)
    found = colors_in(file, arrays, near)
    if not is_rows(found, 3) or found.shape[0] not in counts:
        raise wrong(found, f"numbers of shape ({either(counts)}, 3)", SettingError)
    return Scaled(found)


class Scaled:
    """Scales colors, whole numbers or floats, to 0 to 1."""

    def __init__(self, array: Rows) -> None:
        self.name, self.shape, self._array = array.name, array.shape, array
        self.dtype = np.dtype("f4")
        self._full = full_of(array.name, array.dtype, numbers(array))

    def blocks(self, rows: int) -> Iterator[NDArray[Any]]:
        for block in self._array.blocks(rows):
            with np.errstate(invalid="ignore"):  # of a NaN that signals
                colors = (block / self._full).astype(np.float32)
            yield colors


def column_of(array: Array, *counts: int) -> Array:
    """Return the array as a column of numbers whose length is one of `counts`.

    Raises
    ------
    SettingError
        If it is not.
    """
    column = level(array, 1)
    if not is_column(column) or column.shape[0] not in counts:
        raise wrong(array, f"numbers of shape ({either(counts)},)", SettingError)
    return column


def either(counts: tuple[int, ...]) -> str:
    """Return counts in words, for an error."""
    return " or ".join(map(str, counts))


def numbers(column: Rows | None) -> Iterator[NDArray[Any]]:
    """Return the numbers from which a color map takes its range, block by block."""
    return iter(()) if column is None else column.blocks(POINTS_AT_ONCE)


def together(first: Rows, *others: Rows | None) -> Iterator[tuple[Any, ...]]:
    """Yield the rows of arrays of one length, block by block; None for an array that is missing."""
    there = [first, *(other for other in others if other is not None)]
    widest = max(math.prod(array.shape[1:]) * array.dtype.itemsize for array in there)
    rows = min(POINTS_AT_ONCE, max(1, BLOCK_BYTES // max(1, widest)))
    for blocks in zip(*(array.blocks(rows) for array in there), strict=True):
        found = iter(blocks[1:])
        yield blocks[0], *(None if other is None else next(found) for other in others)
