"""The scans of an E57 file, in the process that reads it: blocks of columns, poses applied."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pye57 import libe57

from bfrt.errors import SceneError
from bfrt.formats.columns import POSITION, combined
from bfrt.formats.source import printable, said

#: Points of a block, and fields that a scan may have.
POINTS = 1 << 16
MOST_FIELDS = 256

#: What the standard calls positions, colors and the state of a point that is none.
CARTESIAN = ("cartesianX", "cartesianY", "cartesianZ")
SPHERICAL = ("sphericalRange", "sphericalAzimuth", "sphericalElevation")
INVALID = ("cartesianInvalidState", "sphericalInvalidState")
COLORS = {"red": "colorRed", "green": "colorGreen", "blue": "colorBlue"}

NUMBERS = {
    libe57.NodeType.E57_INTEGER: libe57.IntegerNode,
    libe57.NodeType.E57_SCALED_INTEGER: libe57.ScaledIntegerNode,
    libe57.NodeType.E57_FLOAT: libe57.FloatNode,
}


class Scan:
    """Reads one scan.

    Parameters
    ----------
    image : libe57.ImageFile
    node : libe57.StructureNode
        The scan in it.
    place : str
        The file's name and the scan's number, for errors.
    """

    def __init__(self, image: Any, node: Any, place: str) -> None:
        self._image = image
        self._node = node
        self._place = place
        self._points = node["points"]
        prototype = libe57.StructureNode(self._points.prototype())
        if prototype.childCount() > MOST_FIELDS:
            raise SceneError(
                f"{place}: found {prototype.childCount()} fields, expected {MOST_FIELDS} or fewer"
            )
        children = [prototype.get(k) for k in range(prototype.childCount())]
        self._fields = {c.elementName(): c for c in children if c.type() in NUMBERS}
        self.count: int = self._points.childCount()
        self._axes = next((a for a in (CARTESIAN, SPHERICAL) if set(a) <= set(self._fields)), None)
        if self._axes is None:
            raise SceneError(
                f"{place}: found fields {' '.join(map(printable, self._fields)) or 'none'}, "
                f"expected {' '.join(CARTESIAN)}, or {' '.join(SPHERICAL)}"
            )
        colors = COLORS if set(COLORS.values()) <= set(self._fields) else {}
        self.names = [*POSITION, *colors, *self._fields]
        self._rotation, self._translation = self._pose()

    def _pose(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return the rotation (3, 3) and the translation (3,) of the scan."""
        rotation, translation = np.eye(3), np.zeros(3)
        if self._node.isDefined("pose/rotation"):
            rotation = matrix_of([self._node[f"pose/rotation/{k}"].value() for k in "wxyz"])
        if self._node.isDefined("pose/translation"):
            places = [self._node[f"pose/translation/{axis}"].value() for axis in POSITION]
            translation = np.array(places, np.float64)
        if not (np.isfinite(rotation).all() and np.isfinite(translation).all()):
            raise SceneError(
                f"{self._place}: found a pose of no rotation or no place, expected finite numbers"
            )
        return rotation, translation

    def blocks(self, names: Sequence[str]) -> Iterator[NDArray[np.float64]]:
        """Yield columns of the points that are valid, (n, len(names)), block by block."""
        if not self.count:  # which the library does not read
            return
        assert self._axes is not None
        own = [COLORS.get(name, name) for name in names if name not in POSITION]
        states = [name for name in INVALID if name in self._fields]
        wanted = list(dict.fromkeys((*self._axes, *own, *states)))
        held = {name: np.zeros(POINTS) for name in wanted}
        buffers = libe57.VectorSourceDestBuffer()
        for name, column in held.items():
            buffers.append(libe57.SourceDestBuffer(self._image, name, column, POINTS, True, True))
        reader = self._points.reader(buffers)
        done = 0
        while got := reader.read():
            done += got
            valid = np.ones(got, np.bool_)
            for name in states:
                valid &= held[name][:got] == 0
            yield self._block(names, {name: c[:got][valid] for name, c in held.items()})
        reader.close()
        if done != self.count:
            raise SceneError(
                f"{self._place}: found {done} points, expected {self.count}: the file is "
                "truncated or its count is wrong"
            )

    @np.errstate(all="ignore")  # what is too large is refused where it comes
    def _block(
        self, names: Sequence[str], held: dict[str, NDArray[np.float64]]
    ) -> NDArray[np.float64]:
        assert self._axes is not None
        columns = dict(held)
        if any(name in POSITION for name in names):
            places = np.stack([held[axis] for axis in self._axes], axis=-1)
            if self._axes == SPHERICAL:
                places = cartesian(places)
            places = combined(places, self._rotation.T) + self._translation
            columns.update(zip(POSITION, places.T, strict=True))
        for name, field in COLORS.items():
            if name in names and name not in self._fields:
                low, high = self._limits(name, field)
                columns[name] = (held[field] - low) / (high - low)
        return np.stack([columns[name] for name in names], axis=-1)

    def _limits(self, name: str, field: str) -> tuple[float, float]:
        """Return the numbers of no color and of full color: the scan's, else the field's own."""
        limits = f"colorLimits/color{name.capitalize()}"
        if all(self._node.isDefined(f"{limits}{end}") for end in ("Minimum", "Maximum")):
            low, high = (float(self._node[f"{limits}{e}"].value()) for e in ("Minimum", "Maximum"))
        else:
            node = NUMBERS[self._fields[field].type()](self._fields[field])
            low, high = float(node.minimum()), float(node.maximum())
        return (low, high) if high > low else (0.0, 1.0)


class Scans:
    """Reads the scans of a file.

    Raises
    ------
    SceneError
        If it is no E57 file, or has no scan of points, or scans without common columns.
    """

    def __init__(self, path: str) -> None:
        self._path = path
        try:
            self._image = libe57.ImageFile(path, "r")
            root = self._image.root()
            nodes = root["data3D"] if root.isDefined("data3D") else []
            self._scans = [
                Scan(self._image, nodes[k], f"{path}: scan {k}") for k in range(len(nodes))
            ]
        except (SceneError, MemoryError):
            raise
        except Exception as error:
            raise self._failure(error) from error
        self.count = sum(scan.count for scan in self._scans)
        first = self._scans[0].names if self._scans else [*POSITION]
        self.names = [name for name in first if all(name in s.names for s in self._scans)]

    def blocks(self, names: Sequence[str]) -> Iterator[NDArray[np.float64]]:
        """Yield columns of all scans, (n, len(names)), block by block; else as the class."""
        try:
            for scan in self._scans:
                yield from scan.blocks(names)
        except (SceneError, MemoryError):
            raise
        except Exception as error:
            raise self._failure(error) from error

    def _failure(self, error: Exception) -> SceneError:
        return SceneError(f"{self._path}: found {said(error)}, expected an E57 file that is whole")


def matrix_of(quaternion: Sequence[float]) -> NDArray[np.float64]:
    """Return the rotation (3, 3) of a quaternion w, x, y, z of any length but 0, else NaN."""
    given = np.array(quaternion, np.float64)
    length = np.sqrt(given @ given)
    with np.errstate(all="ignore"):
        w, x, y, z = given / length
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    )


def cartesian(places: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return places (n, 3) of range, azimuth and elevation as x, y and z."""
    far, azimuth, elevation = places.T
    flat = far * np.cos(elevation)
    return np.stack(
        [flat * np.cos(azimuth), flat * np.sin(azimuth), far * np.sin(elevation)], axis=-1
    )
