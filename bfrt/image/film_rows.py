"""Rows of a film that others have filled, put together to a film.

Sums are integers and every row is filled by one, so that it does not matter who fills which.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from bfrt.image.film import Film

#: The arrays of some rows' elements, as `Film.planes` has them.
Planes = list[NDArray[Any]]


def first_rows(film: Film, count: int) -> Planes:
    """Return the arrays of the first rows of a film."""
    elements = count * film.shape[1]
    return [plane[:elements] for plane, _ in film.planes()]


def put_rows(film: Film, rows: NDArray[np.uint32], planes: Planes) -> None:
    """Take rows of elements of a film's band, by their numbers in the frame."""
    here, across = rows - film.row, film.shape[1]
    for (plane, _), given in zip(film.planes(), planes, strict=True):
        if len(plane):
            of_a_row = (across, *plane.shape[1:])
            plane.reshape(-1, *of_a_row)[here] = given.reshape(-1, *of_a_row)
