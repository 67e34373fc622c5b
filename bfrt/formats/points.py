"""Points, which become spheres of a radius that is given or that each has."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from bfrt.errors import SettingError
from bfrt.formats.outlet import Outlet

#: Points that are read at once.
BLOCK = 1 << 16


class PointBlock(NamedTuple):
    """Some points.

    Attributes
    ----------
    centers : (n, 3) float32 or float64
    radii : (n,) ndarray, optional
        Each one's own.
    values : (n,) or (n, 3) ndarray, optional
        What each is painted by.
    """

    centers: NDArray[Any]
    radii: NDArray[Any] | None = None
    values: NDArray[Any] | None = None


class Points(Protocol):
    """Points that can be read again and again.

    Attributes
    ----------
    name : str
        Of the file, for errors.
    painted : bool
        Whether they have numbers or colors to be painted by.
    """

    name: str
    painted: bool

    def blocks(self) -> Iterator[PointBlock]:
        """All points; radii are each one's own where the setting names them or the file has any."""
        ...

    def numbers(self) -> Iterator[NDArray[Any]]:
        """What a map's range is taken from."""
        ...


def write_points(points: Points, outlet: Outlet) -> None:
    """All points as spheres.

    Raises
    ------
    SettingError
        If neither the setting nor the file has a radius.
    """
    reading = outlet.reading
    radius = None if isinstance(reading.radius, str) else reading.radius
    if points.painted:
        outlet.paint_by(points.numbers())
    for centers, radii, values in points.blocks():
        if radii is None:
            if radius is None:
                raise SettingError(
                    f"{points.name}: found points without a radius, expected radius="
                )
            radii = np.full(len(centers), float(radius))
        outlet.spheres(centers, radii, values)
