"""Names of the pictures of several views: a pattern has one place for the view's number."""

from __future__ import annotations

import os
import re

from bfrt.errors import SettingError

#: ``{}``, ``{:03d}``, ``%d`` or ``%03d``, of which the digits say how many the number has.
PLACE = re.compile(r"\{(?::(?P<format>0?[1-9]?)d)?\}|%(?P<percent>0?[1-9]?)d")

EXPECTED = "one, as in view-{:03d}.png or view-%03d.png"


def has_place(pattern: str | os.PathLike[str]) -> bool:
    """Tell whether a path has a place for a number, or several."""
    return PLACE.search(os.fspath(pattern)) is not None


def numbered(pattern: str | os.PathLike[str], count: int) -> list[str]:
    """Return the path of each view, whose numbers begin at 0.

    Raises
    ------
    SettingError
        If the pattern has no place for a number, or more than one.
    """
    text = os.fspath(pattern)
    places = list(PLACE.finditer(text))
    if len(places) != 1:
        raise SettingError(
            f"{text}: found {len(places)} places for a view's number, expected {EXPECTED}"
        )
    (place,) = places
    width = place["format"] or place["percent"] or ""
    before, behind = text[: place.start()], text[place.end() :]
    return [f"{before}{number:{width}d}{behind}" for number in range(count)]
