"""Colors of numbers, and a file's own, to a palette's few materials.

A map has `STEPS` colors (`bfrt.image.colormaps`). Colors that a file has itself are rounded to 5, 6
and 5 bits, so that the palette of a billion points has at most 65,536 of them and an object's
material takes two bytes.
"""

from __future__ import annotations

import logging
from collections.abc import Iterable
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from bfrt.errors import SceneError, SettingError
from bfrt.formats.ranges import Blocks, ends_of
from bfrt.formats.reading import RGB, Reading
from bfrt.image.color_scale import ColorScale
from bfrt.image.colormaps import DEFAULT, colormap, linear
from bfrt.store.model import Material

log = logging.getLogger(__name__)

#: What full color is in 8 and in 16 bits.
FULL_8, FULL_16 = 255.0, 65535.0

#: How far beyond full a color of floats may be rounded.
ROUNDED = 1e-6

#: What has no number is painted with.
NO_VALUE = (0.5, 0.5, 0.5)


class Materials(Protocol):
    """Gives materials their indices."""

    def material(self, material: Material, /) -> int: ...


class Painter:
    """Gives objects materials by their numbers or by their colors.

    Parameters
    ----------
    sink
        The sink that gives materials their indices.
    reading : Reading
    values : callable
        Yields all numbers, block by block, as often as it is called, to find their range; not
        called where that is given.

    Attributes
    ----------
    scale : ColorScale, optional
        Which colors numbers have; None for colors of the file's own.
    strange : int
        Colors painted so far that are not from 0 to 1: the nearest are taken, 0 for NaN.
    """

    def __init__(self, sink: Materials, reading: Reading, values: Blocks, name: str) -> None:
        self._sink = sink
        self.strange = 0
        self.scale: ColorScale | None = None
        self._own_colors = reading.color_by == RGB
        if self._own_colors:
            if reading.colormap is not None or reading.color_range is not None or reading.color_log:
                raise SettingError("color_by: found rgb with a map, expected rgb alone")
            self._indices = np.full(1 << 16, -1, np.int64)
            return
        map_name = reading.colormap or DEFAULT
        colors = [*linear(colormap(map_name)), NO_VALUE]
        ends = ends_of(values, reading.ends, name, log=reading.color_log)
        self.scale = ColorScale(str(reading.color_by), map_name, *ends, reading.color_log)
        self._indices = np.array([self._index(color) for color in colors], np.int64)

    def _index(self, color: Iterable[float]) -> int:
        red, green, blue = (float(part) for part in color)
        return self._sink.material(Material((red, green, blue)))

    def paint(self, values: NDArray[Any]) -> NDArray[np.uint32]:
        """Return the materials of objects: of numbers (n,), or of colors (n, 3), sRGB 0 to 1."""
        return self._by_color(values) if self._own_colors else self._by_number(values)

    def _by_number(self, values: NDArray[Any]) -> NDArray[np.uint32]:
        assert self.scale is not None
        found: NDArray[np.uint32] = self._indices[self.scale.steps(values)].astype(np.uint32)
        return found

    def _by_color(self, values: NDArray[Any]) -> NDArray[np.uint32]:
        good = np.logical_and(values >= 0.0, values <= 1.0 + ROUNDED).all(axis=-1)
        self.strange += len(values) - int(np.count_nonzero(good))
        most = np.array([31, 63, 31])
        parts = np.rint(np.clip(np.nan_to_num(values), 0.0, 1.0) * most).astype(np.int64)
        packed = parts @ np.array([1 << 11, 1 << 5, 1])
        for new in np.unique(packed[self._indices[packed] < 0]):
            color = np.array([new >> 11, new >> 5 & 63, new & 31]) / most
            self._indices[new] = self._index(linear(color))
        found: NDArray[np.uint32] = self._indices[packed].astype(np.uint32)
        return found


def full_of(name: str, dtype: np.dtype[Any], blocks: Iterable[NDArray[Any]]) -> float:
    """Return the value that means full color in a file's own colors.

    1 for floats and 255 for bytes. Whole numbers of more bits may be of 8 or of 16: the greatest
    tells, which costs a pass over them, that ends where 16 bits are sure.

    Raises
    ------
    SceneError
        If one is greater than 16 bits hold.
    """
    if dtype.kind not in "iu":
        return 1.0
    if dtype == np.uint8:
        return FULL_8
    greatest = 0
    for block in blocks:
        greatest = max(greatest, int(block.max(initial=0)))
        if dtype.itemsize <= 2 and greatest > FULL_8:
            break
    if greatest > FULL_16:
        raise SceneError(f"{name}: found a color of {greatest}, expected 0 to {int(FULL_16)}")
    if dtype.itemsize > 2 and greatest <= 1:
        return 1.0
    if greatest > FULL_8:
        return FULL_16
    if dtype.itemsize == 2 and greatest:
        log.warning("%s: colors of 16 bits go to %d only: taken as of 8 bits", name, greatest)
    return FULL_8
