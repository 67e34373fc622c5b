"""Bands of a film that others have filled, put together to a picture.

Sums are integers and every element is of one band, so that it does not matter who fills which.
"""

from __future__ import annotations

from typing import Any

from numpy.typing import NDArray

from bfrt.image.film import Film
from bfrt.image.image_buffer import ImageBuffer, resolve

#: The arrays of a band's own elements, as `Film.planes` has them.
Planes = list[NDArray[Any]]


def own_planes(film: Film) -> Planes:
    """Return the arrays of the elements of a film's band that no earlier band has."""
    begin = film.row * film.shape[1]
    first, last = film.elements()
    return [plane[first - begin : last - begin] for plane, _ in film.planes()]


def add_bands(film: Film, planes: Planes, image: ImageBuffer, count: int) -> None:
    """Take the own elements of some bands, one after another, and add their rows to a picture."""
    begin, _ = film.elements()
    for _ in range(count):
        first, last = (element - begin for element in film.elements())
        for own, given in zip(own_planes(film), planes, strict=True):
            own[...] = given[first:last]
        resolve(film, image)
        film.advance()
