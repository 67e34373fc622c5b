"""The scenes of the Standard Procedural Databases, at any size."""

from __future__ import annotations

from bfrt.errors import SettingError
from bfrt.spd.recipe import SpdScene
from bfrt.spd.rings import Rings

__all__ = ["NAMES", "rings", "scene"]

_SCENES: dict[str, type[SpdScene]] = {Rings.name: Rings}

#: The scenes that `scene` knows.
NAMES = tuple(_SCENES)


def rings(size: int) -> SpdScene:
    """A pyramid of `size` layers of chained rings: 10 n (n + 1) (2n + 1) + 1 objects."""
    return Rings(size)


def scene(name: str, size: int) -> SpdScene:
    """The standard scene of this name.

    Parameters
    ----------
    name : str
        One of `NAMES`.
    size : int
        The package's size factor, 1 or more.

    Raises
    ------
    SettingError
        If there is no scene of this name, or the size is less than 1.
    """
    if name not in _SCENES:
        raise SettingError(f"spd: found scene {name!r}, expected one of {', '.join(NAMES)}")
    return _SCENES[name](size)
