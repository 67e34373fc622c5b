"""``visibility``: how much of what is around points is open."""

from __future__ import annotations

import math
from functools import partial

import numpy as np
from numpy.typing import NDArray

from bfrt.errors import SettingError
from bfrt.queries._outlook import Outlook, Spread
from bfrt.queries.answers import Fields
from bfrt.queries.points import Look, Records, RowPerPoint, is_bad
from bfrt.records import RayKind
from bfrt.settings import at_least_one, number_of
from bfrt.store.store import Store

VISIBILITY: Fields = {"visibility": (np.float32, ())}

#: Rays of a point at the most.
MOST_RAYS = 65536


def visibility(rays: int, distance: float, *, around_normals: bool, cosine: bool) -> RowPerPoint:
    """Return `bfrt.visibility`, for so many rays from each point to that distance.

    Raises
    ------
    SettingError
        If a setting is out of range.
    """
    each = at_least_one("rays", rays, MOST_RAYS)
    length = number_of(distance)
    if not length > 0.0:
        raise SettingError(f"distance: found {distance!r:.80}, expected a number above 0")
    if cosine and not around_normals:
        raise SettingError("cosine: found True without normals, expected with them only")
    spread = (Spread.COSINE if cosine else Spread.UNIFORM) if around_normals else Spread.AROUND
    return RowPerPoint(
        RayKind.SHADOW,
        each,
        length,
        partial(_look, each, spread),
        partial(_open_or_bad, each),
        VISIBILITY,
        partial(_part, each),
    )


def _look(each: int, spread: Spread, store: Store) -> Look:
    bounds = store.bounds
    corners = np.zeros((2, 3)) if bounds.empty else np.stack([bounds.lo, bounds.hi])
    outlook = Outlook(each, spread, store.origin, corners)

    def look(first: int, points: Records, normals: Records | None) -> tuple[Records, Records]:
        origins, directions = np.empty((2, len(points) * each, 3))
        p, n = (
            np.ascontiguousarray(rows, np.float64)
            for rows in (points, points[:0] if normals is None else normals)
        )
        outlook.fill(first, p, n, origins, directions)
        return origins, directions

    return look


def _open_or_bad(each: int, rays: Records) -> NDArray[np.uint32]:
    """Return 1 for a ray that is open, and for a bad one more than all rays of a point."""
    return np.where(is_bad(rays), np.uint32(each + 1), np.uint32(1))


def _part(each: int, sums: NDArray[np.int64]) -> NDArray[np.float32]:
    """Return which part of the rays of points is open, NaN where there is a bad one."""
    part = np.where(sums > each, math.nan, sums / each)
    return part.astype(np.float32)
