"""Cells of a raster as triangles: corners are the middles of pixels, and a cell has four.

::

    a ── b      two triangles a cell: a b c and a c d, which turn so that their normals
    │ ╲  │      have z > 0, whichever way columns and rows go; a cell one of whose corners
    d ── c      is missing has none

Where cells are missing a line could pass below the ground beside. Walls that stand on a floor stop
it: below each side of such a cell, where both its ends are there.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

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
    a, b, c, d = around(corners)
    whole = np.logical_and.reduce(around(there))
    order = (a, c, b, a, d, c) if turned else (a, b, c, a, c, d)
    made = np.empty((*whole.shape, 6, 3))
    for k, corner in enumerate(order):
        made[:, :, k] = corner
    return (made if whole.all() else made[whole]).reshape(-1, 9)


def around(each: NDArray[Any]) -> tuple[NDArray[Any], ...]:
    """Return what the four corners a, b, c and d of each cell have."""
    return each[:-1, :-1], each[:-1, 1:], each[1:, 1:], each[1:, :-1]


def walls_of(
    corners: NDArray[np.float64], there: NDArray[np.bool_], floor: float
) -> NDArray[np.float64]:
    """Return the walls (n, 9) around missing cells, down to a height; else as `triangles_of`."""
    places, found = around(corners), around(there)
    missing = ~np.logical_and.reduce(found)
    made = []
    for k in range(4):
        side = missing & found[k] & found[k - 1]
        p, q = places[k][side], places[k - 1][side]
        below = [np.column_stack([end[:, :2], np.full(len(end), floor)]) for end in (p, q)]
        made.append(np.hstack([p, q, below[1]])[q[:, 2] > floor])
        made.append(np.hstack([p, below[1], below[0]])[p[:, 2] > floor])
    return np.concatenate(made)


def parts_of(rows: Rows) -> Iterator[tuple[Rows, slice]]:
    """Divide rows into parts of no more than `CELLS_AT_ONCE` cells, in their order."""
    count, width = rows.heights.shape
    each = max(CELLS_AT_ONCE // (width - 1), 1)
    for first in range(0, count - 1, each):
        part = slice(first, min(first + each, count - 1) + 1)
        some = Rows(rows.first + first, rows.heights[part], rows.there[part])
        for column in range(0, width - 1, CELLS_AT_ONCE):
            yield some, slice(column, min(column + CELLS_AT_ONCE, width - 1) + 1)


def triangles_in(
    place: Place, rows: Rows, bend: float = 0.0, floor: float | None = None
) -> Iterator[NDArray[np.float64]]:
    """Yield the triangles (n, 9) of the cells between some rows, and walls down to a floor.

    Parameters
    ----------
    place : Place
    rows : Rows
    bend : float
        As for `corners_of`.
    floor : float, optional
        A height; without it there are no walls.
    """
    for some, columns in parts_of(rows):
        corners, there = corners_of(place, some, columns, bend), some.there[:, columns]
        yield triangles_of(corners, there, place.determinant < 0)
        if floor is not None and not there.all():
            yield walls_of(corners, there, floor)
