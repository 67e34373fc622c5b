"""What a viewshed is asked for: who looks, from where, how far; checked."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from bfrt.errors import SettingError
from bfrt.formats.reading import Reading

#: The part of the earth's curvature that refraction takes back, for light near the ground.
REFRACTION = 1.0 / 7.0

#: Bands of a GeoTIFF.
MOST_OBSERVERS = 65535


@dataclass(frozen=True)
class Sight:
    """Holds the checked settings of a viewshed.

    Attributes
    ----------
    positions : (n, 2) float64
        x and y of the observers.
    heights : (n,) float64
        Of eyes above the ground, in the raster's units of heights.
    target_height : float
        Of what is looked at, likewise.
    reach : float
        In units of x and y; infinite for all.
    reading : Reading
        How the raster is read: its band, and its curvature.
    memory : int
        Bytes of the budget.
    threads : int, optional
    """

    positions: NDArray[np.float64]
    heights: NDArray[np.float64]
    target_height: float
    reach: float
    reading: Reading
    memory: int
    threads: int | None

    @property
    def scale(self) -> float:
        """Return what heights are multiplied by."""
        return 1.0 if self.reading.height_scale is None else self.reading.height_scale


def checked(
    name: str, value: object, *, least: float = -math.inf, above: float = -math.inf
) -> float:
    """Return a setting that is a finite number.

    Raises
    ------
    SettingError
        If it is none, or is out of range.
    """
    try:
        number = float(value)  # type: ignore[arg-type]
    except (TypeError, ValueError):
        number = math.nan
    if not (math.isfinite(number) and number >= least and number > above):
        bound = f" above {above:g}" if above > -math.inf else ""
        bound = f" of {least:g} or more" if least > -math.inf else bound
        raise SettingError(f"{name}: found {value!r:.80}, expected a finite number{bound}")
    return number


def positions_of(observers: ArrayLike) -> NDArray[np.float64]:
    """Return the places of observers, (n, 2).

    Raises
    ------
    SettingError
        If they are none.
    """
    try:
        found = np.asarray(observers, np.float64)
    except (TypeError, ValueError):
        found = np.empty(0)
    rows = found[None] if found.ndim == 1 else found
    if rows.ndim != 2 or rows.shape[1] != 2 or not 0 < len(rows) <= MOST_OBSERVERS:
        raise SettingError(
            f"observers: found an array of shape {found.shape}, expected (n, 2), of "
            f"{MOST_OBSERVERS} at the most"
        )
    if not np.isfinite(rows).all():
        raise SettingError("observers: found a number that is not finite, expected x and y")
    return rows


def heights_of(height: ArrayLike, count: int) -> NDArray[np.float64]:
    """Return the heights of eyes above the ground, (count,).

    Raises
    ------
    SettingError
        If they are not one for each observer, or one for all, above 0.
    """
    try:
        found = np.asarray(height, np.float64)
    except (TypeError, ValueError):
        found = np.empty((0, 0))
    if found.shape not in ((), (count,)) or not (found > 0).all() or np.isinf(found).any():
        raise SettingError(
            f"height: found {height!r:.80}, expected a finite number above 0, or one for each of "
            f"{count} observers"
        )
    return np.broadcast_to(found, (count,))
