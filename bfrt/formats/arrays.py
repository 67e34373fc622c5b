"""Scenes made of arrays with names: spheres, triangles, meshes, and points with columns beside.

A format that keeps arrays (.npy, .npz, HDF5) gives each as an `Array`, of which rows are read
forwards; what they mean is told by their names and shapes, here:

=========================  =========================================================
names                      what they are
=========================  =========================================================
``vertices``, ``faces``    (v, 3) and (f, k) whole numbers from 0: a mesh
``triangles``              (n, 3, 3) or (n, 9)
``spheres``                (n, 4): x y z and the radius
`CENTERS`, ``radii``       (n, 3) and (n,): spheres, or points where there are no radii
any other                  (n,) columns to color by; ``colors`` (n, 3) for ``rgb``
=========================  =========================================================
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Mapping
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from bfrt.errors import SceneError, SettingError
from bfrt.formats.colors import Painter
from bfrt.formats.mesh import Faces, write_mesh
from bfrt.formats.outlet import Outlet
from bfrt.formats.points import BLOCK, PointBlock, write_points
from bfrt.formats.reading import RGB, Reading

#: Names that positions go by.
CENTERS = ("centers", "positions", "points", "coordinates", "pos", "coords", "xyz")
RADII = ("radii", "radius")
COLORS = ("colors", "rgb", "color")

#: What full color is, of whole numbers.
FULL = {np.dtype("u1"): 255.0, np.dtype("u2"): 65535.0}


class Array(Protocol):
    """An array whose rows can be read again and again."""

    name: str
    shape: tuple[int, ...]
    dtype: np.dtype[Any]

    def blocks(self, rows: int) -> Iterator[NDArray[Any]]:
        """All rows, `rows` at a time, the last fewer."""
        ...


Arrays = Mapping[str, Array]


def write_arrays(file: str, arrays: Arrays, outlet: Outlet) -> None:
    """Write what arrays with names hold.

    Raises
    ------
    SceneError
        If no names or shapes are known.
    SettingError
        If a setting names what is not there.
    """
    reading = outlet.reading
    if reading.positions is None and "vertices" in arrays and "faces" in arrays:
        write_mesh(ArrayMesh(file, arrays, reading), outlet)
    elif reading.positions is None and "triangles" in arrays:
        write_triangles(arrays, outlet)
    else:
        reading.refuse_all_but(
            file, "positions", "radius", "color_by", "colormap", "color_range", "skip_invalid"
        )
        write_points(ArrayPoints(file, arrays, reading), outlet)


def write_triangles(arrays: Arrays, outlet: Outlet) -> None:
    """Triangles as they are, painted by a column of as many."""
    reading, triangles = outlet.reading, arrays["triangles"]
    reading.refuse_all_but(outlet.name, "color_by", "colormap", "color_range", "skip_invalid")
    if triangles.shape[1:] not in ((3, 3), (9,)):
        raise wrong(triangles, "(n, 3, 3) or (n, 9)")
    column = painting(arrays, reading, outlet.name, triangles.shape[0])
    painter = None
    if column is not None:
        painter = Painter(outlet.sink, reading, numbers(column), outlet.name)
    dtype = floats(triangles)
    for block, values in together(triangles, column):
        materials = None if painter is None or values is None else painter.paint(values)
        outlet.triangles(block.reshape(len(block), 9).astype(dtype, copy=False), materials)


class ArrayPoints:
    """Positions with columns beside: `bfrt.formats.points.Points`."""

    def __init__(self, file: str, arrays: Arrays, reading: Reading) -> None:
        self.name = file
        self._centers = self._find_centers(arrays, reading)
        self._has_radii = self._centers.shape[1:] == (4,)
        if self._centers.shape[1:] not in ((3,), (4,)):
            raise wrong(self._centers, "(n, 3), or (n, 4) with radii")
        count = self._centers.shape[0]
        self._radii = self._find_radii(arrays, reading, count)
        self._values = painting(arrays, reading, file, count)
        self.painted = self._values is not None

    def _find_centers(self, arrays: Arrays, reading: Reading) -> Array:
        if reading.positions is not None:
            return named(arrays, reading.positions, self.name, "positions")
        known = ("spheres", *CENTERS)
        found = [key for key in arrays if key.rpartition("/")[2].lower() in known]
        if len(found) != 1:
            raise SceneError(
                f"{self.name}: found {listed(found or arrays)}, expected one array named as "
                f"one of {', '.join(known)}, or positions= with its name"
            )
        return arrays[found[0]]

    def _find_radii(self, arrays: Arrays, reading: Reading, count: int) -> Array | None:
        """The radii's array, unless positions have a fourth column or one number is given."""
        if isinstance(reading.radius, str):
            found = beside(arrays, reading.radius, self._centers.name, self.name, "radius")
        elif reading.radius is None and not self._has_radii:
            folder = self._centers.name.rpartition("/")[0]
            names = [f"{folder}/{name}" if folder else name for name in RADII]
            there = [arrays[name] for name in names if name in arrays]
            if not there:
                return None
            found = there[0]
        else:
            return None
        return column_of(found, count)

    def blocks(self) -> Iterator[PointBlock]:
        dtype = floats(self._centers)
        for block, radii, values in together(self._centers, self._radii, self._values):
            positions = block.astype(dtype, copy=False)
            own = positions[:, 3] if self._has_radii and radii is None else radii
            yield PointBlock(positions[:, :3], own, values)

    def numbers(self) -> Iterator[NDArray[Any]]:
        return numbers(self._values)


class ArrayMesh:
    """Vertices and faces: `bfrt.formats.mesh.Mesh`."""

    def __init__(self, file: str, arrays: Arrays, reading: Reading) -> None:
        self.name = file
        self._vertices, self._faces = arrays["vertices"], arrays["faces"]
        if self._vertices.shape[1:] != (3,):
            raise wrong(self._vertices, "(n, 3)")
        each = self._faces.shape[1:]
        if len(each) != 1 or not 3 <= each[0] < 1 << 20 or self._faces.dtype.kind not in "iu":
            raise wrong(self._faces, "(n, 3) whole numbers, or as many as faces have corners")
        self.vertices = self._vertices.shape[0]
        self.coordinates = floats(self._vertices)
        counts = (self.vertices, self._faces.shape[0])
        self._column = painting(arrays, reading, file, *counts)
        self.painted = self._column is not None
        self._of_vertices = self.painted and self._rows() == self.vertices
        self.row = self.coordinates
        self.columns = 3
        if self._of_vertices and self._column is not None:
            self.columns += self._column.shape[1] if len(self._column.shape) == 2 else 1
            self.row = np.promote_types(self.coordinates, floats(self._column))

    def _rows(self) -> int:
        return 0 if self._column is None else self._column.shape[0]

    def vertex_blocks(self) -> Iterator[NDArray[Any]]:
        beside = self._column if self._of_vertices else None
        for block, values in together(self._vertices, beside):
            parts = [block] if values is None else [block, values.reshape(len(block), -1)]
            yield np.hstack(parts).astype(self.row, copy=False)

    def face_blocks(self) -> Iterator[Faces]:
        beside = None if self._of_vertices else self._column
        for block, values in together(self._faces, beside):
            counts = np.full(len(block), block.shape[1], np.uint32)
            # What 64 signed bits do not hold is no vertex either.
            indices = np.minimum(block, 1 << 62).astype(np.int64).reshape(-1)
            yield Faces(indices, counts, values)

    def numbers(self) -> Iterator[NDArray[Any]]:
        return numbers(self._column)


def painting(arrays: Arrays, reading: Reading, file: str, *counts: int) -> Array | None:
    """The array that colors are made of, with a row for each of so many things."""
    if reading.color_by is None:
        return None
    if reading.color_by == RGB:
        there = [array for key, array in arrays.items() if key.rpartition("/")[2].lower() in COLORS]
        if len(there) != 1 or there[0].shape[1:] != (3,):
            raise SettingError(
                f"{file}: found {listed(arrays)}, expected one array of colors (n, 3), named as "
                f"one of {', '.join(COLORS)}"
            )
        found = Scaled(there[0])
        if found.shape[0] not in counts:
            raise wrong(found, f"({' or '.join(map(str, counts))}, 3)")
        return found
    near = reading.positions or next(iter(arrays), "")
    found_column = beside(arrays, reading.color_by, near, file, "color_by")
    return column_of(found_column, *counts)


class Scaled:
    """Colors from 0 to 1, of whole numbers or of floats."""

    def __init__(self, array: Array) -> None:
        self.name, self.shape, self._array = array.name, array.shape, array
        self.dtype = np.dtype("f4")

    def blocks(self, rows: int) -> Iterator[NDArray[Any]]:
        full = FULL.get(self._array.dtype, 1.0)
        for block in self._array.blocks(rows):
            yield (block / full).astype(np.float32)


def named(arrays: Arrays, name: str, file: str, setting: str) -> Array:
    """The array of a name.

    Raises
    ------
    SettingError
        If there is none.
    """
    if name not in arrays:
        raise SettingError(
            f"{file}: found no array {name!r} for {setting}, expected one of {listed(arrays)}"
        )
    return arrays[name]


def beside(arrays: Arrays, name: str, near: str, file: str, setting: str) -> Array:
    """The array of a name, in the folder of another or by its whole name."""
    folder = near.rpartition("/")[0]
    whole = f"{folder}/{name}"
    return arrays[whole] if whole in arrays else named(arrays, name, file, setting)


def column_of(array: Array, *counts: int) -> Array:
    """The array, if it is a column of numbers for as many things."""
    if len(array.shape) != 1 or array.shape[0] not in counts or array.dtype.kind not in "fiub":
        raise wrong(array, f"numbers of shape ({' or '.join(map(str, counts))},)")
    return array


def numbers(column: Array | None) -> Iterator[NDArray[Any]]:
    """What a map's range is taken from."""
    return iter(()) if column is None else column.blocks(BLOCK)


def together(first: Array, *others: Array | None) -> Iterator[tuple[Any, ...]]:
    """The rows of arrays of one length, block by block; None for what is not there."""
    streams: list[Iterator[Any]] = [first.blocks(BLOCK)]
    for other in others:
        streams.append(itertools.repeat(None) if other is None else other.blocks(BLOCK))
    return zip(*streams, strict=False)  # what repeats has no end


def floats(array: Array) -> np.dtype[Any]:
    """float32 where that holds the numbers exactly, else float64."""
    if array.dtype.kind not in "fiu" or array.dtype.itemsize > 8:
        raise wrong(array, "numbers of 64 bits or fewer")
    return np.dtype("f4") if np.can_cast(array.dtype, np.float32) else np.dtype("f8")


def wrong(array: Array, expected: str) -> SceneError:
    """What is said of an array of another shape or type."""
    return SceneError(
        f"{array.name}: found {array.dtype} of shape {array.shape}, expected {expected}"
    )


def listed(names: Any) -> str:
    """Names as an error shows them."""
    shown = list(names)
    return ", ".join(shown[:12]) + (", ..." if len(shown) > 12 else "") or "no arrays"
