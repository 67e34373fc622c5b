"""Cells of a raster as triangles: corners are the middles of pixels, and a cell has four.

::

    a ── b      two triangles a cell: a b c and a c d, which turn so that their normals
    │ ╲  │      have z > 0, whichever way columns and rows go; a cell one of whose corners
    d ── c      is missing has none
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from bfrt.formats.raster.facts import Place
from bfrt.formats.raster.remote import Rows

#: Cells that are made triangles at once.
CELLS_AT_ONCE = 1 << 15


def corners_of(
    place: Place, rows: Rows, columns: slice = slice(None), bend: float = 0.0
) -> NDArray[np.float64]:
    """Return the corners of some rows and columns in world coordinates, (rows, columns, 3).

    Parameters
    ----------
    place : Place
    rows : Rows
    columns : slice
    bend : float
        What heights are lowered by for the square of their distance from the raster's middle, for
        the earth's curvature (`bfrt.formats.raster.reader.bend_of`).
    """
    a, b, c, d, e, f = place.transform
    i = np.arange(place.width)[columns] + 0.5
    j = (np.arange(rows.first, rows.first + len(rows.heights)) + 0.5)[:, None]
    heights = rows.heights[:, columns]
    made = np.empty((*heights.shape, 3))
    made[..., 0] = a * i + b * j + c
    made[..., 1] = d * i + e * j + f
    made[..., 2] = heights
    if bend:
        x, y = place.middle
        made[..., 2] -= bend * ((made[..., 0] - x) ** 2 + (made[..., 1] - y) ** 2)
    return made


def triangles_of(
    corners: NDArray[np.float64], there: NDArray[np.bool_], turned: bool
) -> NDArray[np.float64]:
    """Return the triangles (n, 9) of cells, row after row.

    Parameters
    ----------
    corners : (rows, columns, 3) float64
    there : (rows, columns) bool
        Which corners there are.
    turned : bool
        Whether rows and columns turn against x and y.
    """
    whole = there[:-1, :-1] & there[:-1, 1:] & there[1:, 1:] & there[1:, :-1]
    a, b, c, d = corners[:-1, :-1], corners[:-1, 1:], corners[1:, 1:], corners[1:, :-1]
    order = (a, c, b, a, d, c) if turned else (a, b, c, a, c, d)
    made = np.empty((*whole.shape, 6, 3))
    for k, corner in enumerate(order):
        made[:, :, k] = corner
    return (made if whole.all() else made[whole]).reshape(-1, 9)


def parts_of(rows: Rows) -> Iterator[tuple[Rows, slice]]:
    """Divide rows into parts of no more than `CELLS_AT_ONCE` cells, in their order."""
    count, width = rows.heights.shape
    each = max(CELLS_AT_ONCE // (width - 1), 1)
    for first in range(0, count - 1, each):
        part = slice(first, min(first + each, count - 1) + 1)
        some = Rows(rows.first + first, rows.heights[part], rows.there[part])
        for column in range(0, width - 1, CELLS_AT_ONCE):
            yield some, slice(column, min(column + CELLS_AT_ONCE, width - 1) + 1)


def triangles_in(place: Place, rows: Rows, bend: float) -> Iterator[NDArray[np.float64]]:
    """Yield the triangles (n, 9) of the cells between some rows; else as `corners_of`."""
    for some, columns in parts_of(rows):
        corners = corners_of(place, some, columns, bend)
        yield triangles_of(corners, some.there[:, columns], place.determinant < 0)
