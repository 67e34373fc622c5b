"""Points, which become spheres: of one radius, or of a radius for each."""

from __future__ import annotations

import logging
from collections.abc import Iterator
from functools import partial
from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from bfrt.errors import SettingError
from bfrt.formats.object_writer import ObjectWriter
from bfrt.formats.reading import AUTO, Reading
from bfrt.formats.spacing import spacing_of

log = logging.getLogger(__name__)

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
    if points.painted:
        writer.paint_by(points.numbers)
    radius = the_one_radius(points, writer.reading)
    for centers, radii, values in points.blocks():
        if radii is None:
            if radius is None:
                raise missing_radius(points, writer.reading)
            radii = np.full(len(centers), radius)
        writer.spheres(centers, radii, values)


def the_one_radius(points: Points, reading: Reading) -> float | None:
    """Return the radius of all points, if the setting gives one: a number, or their spacing.

    Raises
    ------
    SettingError
        If all points are at one place, so that they have no spacing.
    """
    if reading.radius == AUTO:
        found = spacing_of(partial(centers_of, points))
        if found.distance == 0.0:
            raise SettingError(
                f"{points.name}: found no two points that are apart, expected a number for "
                f"radius= (--radius) in place of {AUTO}"
            )
        log.info(
            "%s: radius %.3g, the median distance of %d of the points to their nearest",
            points.name,
            found.distance,
            found.sample,
        )
        return found.distance
    number = reading.radius is not None and not isinstance(reading.radius, str)
    return float(reading.radius) if number else None  # type: ignore[arg-type]


def missing_radius(points: Points, reading: Reading) -> SettingError:
    """Return an error for points that have no radius, and are given none."""
    if reading.radii is not None:
        return SettingError(
            f"{points.name}: found radius={reading.radius!r} for points without a type, expected "
            f"a number, the name of what has each one's, or {AUTO}"
        )
    return SettingError(
        f"{points.name}: found points without a radius, expected radius= (--radius on the command "
        f"line){proposed(points)}"
    )


def centers_of(points: Points) -> Iterator[NDArray[Any]]:
    """Yield the centers of points, (n, 3), block by block."""
    return (block.centers for block in points.blocks())


def proposed(points: Points) -> str:
    """Propose a radius, in words: the points' spacing; nothing if all are at one place."""
    distance = spacing_of(partial(centers_of, points)).distance
    return f", as {AUTO}, which takes their spacing: {distance:.3g}" if distance else ""
