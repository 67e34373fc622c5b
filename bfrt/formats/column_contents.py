"""What columns of points are, and the options that take them: text, PCD, LAMMPS, E57."""

from __future__ import annotations

from collections.abc import Sequence

from bfrt.formats.columns import COLOR_NAMES, POSITION
from bfrt.formats.contents import COLOR, OWN_COLORS, POINTS, RADIUS, Row


def rows_of_columns(names: Sequence[str], count: int | None, dtype: str) -> list[Row]:
    """List columns of points, each with the options that take it.

    Parameters
    ----------
    names : sequence of str
        Of all columns.
    count : int, optional
        Points, where the file says how many.
    dtype : str
        The type of all columns.
    """
    shape = () if count is None else (count,)
    return [Row(name, shape, dtype, use_of(name, names)) for name in dict.fromkeys(names)]


def use_of(name: str, names: Sequence[str]) -> str:
    """Return what a column becomes, and the options that take it."""
    if name in POSITION:
        return f"{POINTS}, {COLOR.format(name)}"
    if any(name in three and set(three) <= set(names) for three in COLOR_NAMES):
        return OWN_COLORS
    return f"{COLOR.format(name)}, {RADIUS.format(name)}"
