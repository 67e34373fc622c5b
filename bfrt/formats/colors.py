"""Numbers to colors, and colors to a palette's few materials.

A map has `STEPS` colors. Colors that a file has itself are rounded to 5, 6 and 5 bits, so that the
palette of a billion points has at most 65,536 of them and an object's material takes two bytes.
"""

from __future__ import annotations

import logging
import math
from collections.abc import Iterable
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from bfrt.errors import SceneError, SettingError
from bfrt.formats.casting import cast
from bfrt.formats.reading import RGB, Reading
from bfrt.store.model import Material

log = logging.getLogger(__name__)

#: What full color is in 8 and in 16 bits.
FULL_8, FULL_16 = 255.0, 65535.0

#: Colors of a map.
STEPS = 256

#: How far beyond full a color of floats may be rounded.
ROUNDED = 1e-6

#: What has no number is painted with.
NO_VALUE = (0.5, 0.5, 0.5)


class Materials(Protocol):
    """Gives materials their indices."""

    def material(self, material: Material, /) -> int: ...


def cubehelix(t: NDArray[np.float64]) -> NDArray[np.float64]:
    """Compute the cubehelix map: from black to white with rising luminance.

    Parameters
    ----------
    t : (n,) float64
        From 0 to 1.

    Returns
    -------
    (n, 3) float64
        sRGB, 0 to 1: start 0.5, -1.5 rotations, hue 1, gamma 1 (Green 2011, "A colour scheme for
        the display of astronomical intensity images", equations 1 and 2).
    """
    angle = 2.0 * math.pi * (0.5 / 3.0 + 1.0 - 1.5 * t)
    amplitude = t * (1.0 - t) / 2.0
    cosine, sine = np.cos(angle), np.sin(angle)
    shifts = np.stack(
        [
            -0.14861 * cosine + 1.78277 * sine,
            -0.29227 * cosine - 0.90649 * sine,
            1.97294 * cosine,
        ],
        axis=-1,
    )
    return np.clip(t[:, None] + amplitude[:, None] * shifts, 0.0, 1.0)


def colormap(name: str) -> NDArray[np.float64]:
    """Return the `STEPS` colors of a map, (STEPS, 3), sRGB from 0 to 1.

    Raises
    ------
    SettingError
        If it is none of ours, and none of matplotlib's or matplotlib is not there.
    """
    t = np.linspace(0.0, 1.0, STEPS)
    if name == "gray":
        return np.repeat(t[:, None], 3, axis=1)
    if name == "cubehelix":
        # Neither black, which shows no shape, nor white, which shows no light.
        return cubehelix(0.15 + 0.7 * t)
    try:
        from matplotlib import colormaps
    except ImportError:
        raise SettingError(
            f"colormap: found {name!r}, expected cubehelix or gray, or matplotlib for more maps"
        ) from None
    if name not in colormaps:
        raise SettingError(f"colormap: found {name!r}, expected cubehelix, gray or matplotlib's")
    return np.asarray(colormaps[name](t), np.float64)[:, :3]


def linear(color: NDArray[np.float64]) -> NDArray[np.float64]:
    """Convert sRGB to linear light (IEC 61966-2-1), so that a PNG of full light shows the color."""
    low = color / 12.92
    return np.where(color <= 0.04045, low, ((color + 0.055) / 1.055) ** 2.4)


class Painter:
    """Gives objects materials by their numbers or by their colors.

    Parameters
    ----------
    sink
        The sink that gives materials their indices.
    reading : Reading
    values : iterable of ndarray
        All numbers, block by block, to find their range; not looked at where it is given.

    Attributes
    ----------
    strange : int
        Colors painted so far that are not from 0 to 1: the nearest are taken, 0 for NaN.
    """

    def __init__(
        self, sink: Materials, reading: Reading, values: Iterable[NDArray[Any]], name: str
    ) -> None:
        self._sink = sink
        self.strange = 0
        self._own_colors = reading.color_by == RGB
        if self._own_colors:
            if reading.colormap is not None or reading.color_range is not None:
                raise SettingError("color_by: found rgb with a map, expected rgb alone")
            self._indices = np.full(1 << 16, -1, np.int64)
            return
        map_name = reading.colormap or "cubehelix"
        colors = [*linear(colormap(map_name)), NO_VALUE]
        self._lo, self._hi = reading.color_range or value_range(values, name)
        self._indices = np.array([self._index(color) for color in colors], np.int64)

    def _index(self, color: Iterable[float]) -> int:
        red, green, blue = (float(part) for part in color)
        return self._sink.material(Material((red, green, blue)))

    def paint(self, values: NDArray[Any]) -> NDArray[np.uint32]:
        """Return the materials of objects: of numbers (n,), or of colors (n, 3), sRGB 0 to 1."""
        return self._by_color(values) if self._own_colors else self._by_number(values)

    def _by_number(self, values: NDArray[Any]) -> NDArray[np.uint32]:
        span = self._hi - self._lo
        with np.errstate(all="ignore"):
            above = cast(values, np.float64) - self._lo
            step = np.clip(above / span * STEPS if span > 0 else above * 0.0, 0, STEPS - 1)
        known = ~np.isnan(step)
        steps = np.where(known, step, STEPS).astype(np.int64)
        found: NDArray[np.uint32] = self._indices[steps].astype(np.uint32)
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


def value_range(values: Iterable[NDArray[Any]], name: str) -> tuple[float, float]:
    """Find the least and the greatest of all finite numbers.

    Raises
    ------
    SceneError
        If there are none.
    """
    lo, hi = math.inf, -math.inf
    for block in values:
        finite = block[np.isfinite(block)]
        if len(finite):
            lo, hi = min(lo, float(finite.min())), max(hi, float(finite.max()))
    if lo > hi:
        raise SceneError(f"{name}: found no finite number to color by, expected one or more")
    return lo, hi
