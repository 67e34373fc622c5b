"""Points, which become spheres: of one radius, or of a radius for each."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from bfrt.errors import SettingError
from bfrt.formats.object_writer import ObjectWriter, finite

#: Points that are read at once.
POINTS_AT_ONCE = 1 << 16


class PointBlock(NamedTuple):
    """Holds some points.

    Attributes
    ----------
    centers : (n, 3) float32 or float64
    radii : (n,) ndarray, optional
        Each one's own.
    values : (n,) or (n, 3) ndarray, optional
        The number or the color that paints each point.
    """

    centers: NDArray[Any]
    radii: NDArray[Any] | None = None
    values: NDArray[Any] | None = None


class Points(Protocol):
    """Provides points that can be read again and again.

    Attributes
    ----------
    name : str
        Name of the file, for errors.
    painted : bool
        Whether they have numbers or colors to be painted by.
    """

    name: str
    painted: bool

    def blocks(self) -> Iterator[PointBlock]:
        """Yield all points, with radii where the setting names a column or the file has one."""
        ...

    def numbers(self) -> Iterator[NDArray[Any]]:
        """Yield the numbers from which a color map takes its range."""
        ...


def write_points(points: Points, writer: ObjectWriter) -> None:
    """Write all points as spheres.

    Raises
    ------
    SettingError
        If neither the setting nor the file has a radius.
    """
    reading = writer.reading
    radius = None if isinstance(reading.radius, str) else reading.radius
    if points.painted:
        writer.paint_by(points.numbers())
    for centers, radii, values in points.blocks():
        if radii is None:
            if radius is None:
                raise SettingError(
                    f"{points.name}: found points without a radius, expected radius= (--radius on "
                    f"the command line){fitting(points)}"
                )
            radii = np.full(len(centers), float(radius))
        writer.spheres(centers, radii, values)


def fitting(points: Points) -> str:
    """Propose a radius that fits points, in words; nothing if all points are at one place.

    Half their mean spacing: the largest of length / n, (area / n)^(1/2) and (volume / n)^(1/3) of
    their bounds, whose longest sides make the length and the area, so that it is that of a line, a
    surface or a volume, whichever the bounds are.
    """
    lo, hi, count = np.full(3, np.inf), np.full(3, -np.inf), 0
    for centers, _, _ in points.blocks():
        good = centers[finite(centers)].astype(np.float64, copy=False)
        if len(good):
            lo, hi = np.minimum(lo, good.min(axis=0)), np.maximum(hi, good.max(axis=0))
            count += len(good)
    sides = np.sort(hi - lo)[::-1] if count else np.zeros(3)
    logs = np.cumsum(np.log(sides[sides > 0]))
    spacing = max((math.exp((s - math.log(count)) / k) for k, s in enumerate(logs, 1)), default=0.0)
    return f": {spacing / 2:.2g} is half their mean spacing" if spacing else ""
