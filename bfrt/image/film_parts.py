"""Some elements of a film, filled elsewhere, as records: sums add up, and what is seen is put.

Sums are of what is never negative, and stop at the greatest integer: so it does not matter in what
order, or in how many parts, they are added.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from bfrt.image.film import Film

#: What shading adds to an element: R G B A, in units of 2^-32.
SUMS = np.dtype([("element", "<u4"), ("sums", "<i8", 4)])

#: What the first sample has seen, as `Film.planes` has it behind the sums.
_SEEN = [("depth_normal", "<f4", 4), ("id", "<u8"), ("position", "<f4", 3), ("albedo", "<f4", 3)]
_ALWAYS = 2

_MOST = np.iinfo(np.int64).max


class FilmPart(NamedTuple):
    """Holds elements of a film, each once.

    Attributes
    ----------
    sums : (n,) of SUMS
        Those that are not zero.
    seen : (m,) of seen_by(aovs)
        Those that a first sample has seen.
    """

    sums: NDArray[Any]
    seen: NDArray[Any]


def seen_by(aovs: Sequence[str]) -> np.dtype[Any]:
    """Return the record of what is seen, with the channels that are asked for."""
    asked = [field for field in _SEEN[_ALWAYS:] if field[0] in aovs]
    return np.dtype([("element", "<u4"), *_SEEN[:_ALWAYS], *asked])


def film_of(elements: NDArray[np.uint32], aovs: Sequence[str]) -> Film:
    """Return an empty film of some elements, (n,), by their numbers in another."""
    film = Film(len(elements), 1, 1, aovs=aovs)
    film.number(elements)
    return film


def part_of(
    film: Film, elements: NDArray[np.uint32], seen: NDArray[np.bool_], aovs: Sequence[str]
) -> FilmPart:
    """Return what a film of some elements holds, as elements of another.

    Parameters
    ----------
    film : Film
        As `film_of` makes it.
    elements : (n,) uint32
        The number of each in the other film.
    seen : (n,) bool
        Whether a first sample has seen it.
    """
    (all_sums, _), *planes = film.planes()
    touched = all_sums.any(axis=1)
    sums = np.empty(int(touched.sum()), SUMS)
    sums["element"], sums["sums"] = elements[touched], all_sums[touched]
    records = np.empty(int(seen.sum()), seen_by(aovs))
    records["element"] = elements[seen]
    for (name, *_), (plane, _) in zip(_SEEN, planes, strict=True):
        if name in (records.dtype.names or ()):
            records[name] = plane[seen]
    return FilmPart(sums, records)


def add_part(film: Film, part: FilmPart) -> None:
    """Add sums, saturating, to the elements of a film that is in memory, and put what is seen."""
    (all_sums, _), *planes = film.planes()
    first = film.row * film.shape[1]
    at = part.sums["element"].astype(np.int64) - first
    own = all_sums[at]
    all_sums[at] = own + np.minimum(part.sums["sums"], _MOST - own)
    at = part.seen["element"].astype(np.int64) - first
    for (name, *_), (plane, _) in zip(_SEEN, planes, strict=True):
        if name in (part.seen.dtype.names or ()):
            plane[at] = part.seen[name]
