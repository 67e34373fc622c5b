"""Gaussian splats in a PLY file: opaque spheres at their centers.

A splat is an ellipsoid that fades; its sphere has the volume of that at one standard deviation, or
of a flat one, which has two lengths, the area. Its color is that of the harmonics' constant part,
the same from all sides.
"""

from __future__ import annotations

import logging
from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bfrt.errors import SceneError, SettingError
from bfrt.formats.casting import cast
from bfrt.formats.columns import POSITION
from bfrt.formats.ply.element import Element
from bfrt.formats.ply.file import Ply
from bfrt.formats.points import PointBlock
from bfrt.formats.reading import RGB, Reading

log = logging.getLogger(__name__)

CONSTANTS = ("f_dc_0", "f_dc_1", "f_dc_2")
SCALES = ("scale_0", "scale_1", "scale_2")
OPACITY = "opacity"
NEEDED = (*POSITION, *CONSTANTS, *SCALES[:2], OPACITY)

#: What a splat has in place of all that where it is packed, as in a file of SuperSplat's.
PACKED = "packed_position"

#: The spherical harmonic of degree 0, 1 / (2 sqrt(pi)), by which the constant part is multiplied.
HARMONIC = 0.28209479177387814


def are_splats(vertex: Element) -> bool:
    """Tell whether vertices are Gaussian splats, by their properties."""
    return all(vertex.find(name) for name in NEEDED)


def refuse_packed(name: str, vertex: Element) -> None:
    """Refuse vertices that are packed splats.

    Raises
    ------
    SceneError
    """
    if vertex.find(PACKED):
        raise SceneError(
            f"{name}: found Gaussian splats that are packed ({PACKED}), expected x, y and z of "
            "each: unpack them, as splat-transform does"
        )


def colored(reading: Reading) -> Reading:
    """Return the settings of splats, which have their own colors unless others are asked for."""
    return replace(reading, color_by=reading.color_by or RGB)


class Splats:
    """Reads Gaussian splats: a `bfrt.formats.points.Points`."""

    painted = True

    def __init__(self, ply: Ply, vertex: Element, reading: Reading) -> None:
        self.name = ply.name
        self._ply = ply
        self._vertex = vertex
        self._opacity = reading.opacity
        column = reading.radius_column
        self._skip = reading.skip_invalid
        self._scales = tuple(name for name in SCALES if vertex.find(name))
        own = self._scales if reading.radius is None else ()
        self._radius = own if column is None else (column,)
        self._paint = CONSTANTS if reading.color_by in (None, RGB) else reading.columns
        for name in (*self._radius, *self._paint):
            if not vertex.find(name):
                raise SettingError(
                    f"{self.name}: found no {name} of each splat, expected one of its properties"
                )
        log.info(
            "%s: %d Gaussian splats, as opaque spheres%s",
            self.name,
            vertex.rows,
            "" if self._opacity is None else f", those of an opacity of {self._opacity:g} or more",
        )

    def blocks(self) -> Iterator[PointBlock]:
        dtype = self._vertex.dtype_of(POSITION)
        first = 4 + len(self._radius)
        for block in self._columns((*POSITION, *self._radius, *self._paint)):
            yield PointBlock(
                cast(block[:, 1:4], dtype),
                self._radii(block[:, 4:first]) if self._radius else None,
                self._values(block[:, first:]),
            )

    def _columns(self, names: tuple[str, ...]) -> Iterator[NDArray[np.float64]]:
        """Yield the opacity and other columns of the splats that are opaque enough.

        Raises
        ------
        SceneError
            If an opacity is no number; where such are skipped nothing of that splat is one.
        """
        done = 0
        for block in self._ply.columns(self._vertex, (OPACITY, *names)):
            rows = cast(block, np.float64)
            if self._opacity is not None:
                wrong = np.isnan(rows[:, 0])
                if wrong.any() and not self._skip:
                    raise SceneError(
                        f"{self.name}: vertex {done + int(np.argmax(wrong))}: found an opacity of "
                        "nan, expected a number"
                    )
                rows[wrong] = np.nan
                with np.errstate(over="ignore"):
                    rows = rows[~(1.0 / (1.0 + np.exp(-rows[:, 0])) < self._opacity)]
            done += len(block)
            yield rows

    def _radii(self, columns: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return radii: the geometric mean of lengths whose logarithms these are."""
        if self._radius != self._scales:
            return columns[:, 0]
        with np.errstate(over="ignore"):
            radii: NDArray[np.float64] = np.exp(columns.mean(axis=1))
        return radii

    def _values(self, columns: NDArray[np.float64]) -> NDArray[np.float64]:
        if self._paint != CONSTANTS:
            return columns[:, 0]
        colors: NDArray[np.float64] = np.clip(0.5 + HARMONIC * columns, 0.0, 1.0)
        return colors

    def numbers(self) -> Iterator[NDArray[Any]]:
        return (self._values(block[:, 1:]) for block in self._columns(self._paint))
