"""openPMD: records of particles by iteration and species, with units, and offsets of positions.

::

    data/200/particles/e/position/x        float32, unitSI
                         positionOffset/x  whole numbers or a constant, unitSI
                         weighting         a scalar record, unitSI

Numbers are read in SI units, positions with their offsets in meters, as the standard has it:
``position * unitSI + positionOffset * unitSI``, in float64. What has the unit 1 and no offset stays
as the file has it.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bfrt.errors import SceneError
from bfrt.formats.casting import cast
from bfrt.formats.layouts.steps import Attributes, Layout, numbered
from bfrt.formats.naming import folder_of, within
from bfrt.formats.table import Array, Arrays, Listed, wrong

#: Attributes of a file's root, and of a record component.
MARK, BASE, PARTICLES = "openPMD", "basePath", "particlesPath"
UNIT = "unitSI"

POSITION, OFFSET = "position", "positionOffset"

#: A number in the base path, which is that of the iteration.
ITERATION = "%T"


def openpmd_in(file: str, arrays: Arrays, attributes: Attributes) -> Layout | None:
    """Return the layout of an openPMD file that has particles, or None.

    Raises
    ------
    SceneError
        If its paths are no text.
    """
    root = attributes("", MARK, BASE, PARTICLES) or {}
    if MARK not in root or PARTICLES not in root:  # there may be meshes alone
        return None
    base, particles = (path_of(file, root, name) for name in (BASE, PARTICLES))
    whole = within(base, particles)
    number = r"(\d{1,18})"
    pattern = re.compile(f"({number.join(map(re.escape, whole.split(ITERATION)))})/")
    matches = [match for key in arrays if (match := pattern.match(key))]
    found = {int(match[2]) if ITERATION in whole else 0: match[1] for match in matches}
    return Layout(MARK, numbered(found), Components(arrays, attributes)) if found else None


def path_of(file: str, root: dict[str, Any], name: str) -> str:
    """Return a path that the root's attributes have, without the slashes around it."""
    found = root.get(name)
    if not isinstance(found, str) or found.count(ITERATION) > 1:
        raise SceneError(f"{file}: found {name}={found!r:.80}, expected a path, as openPMD has it")
    return found.strip("/")


class Components(Listed):
    """Maps paths to arrays, each record component in SI units."""

    def __init__(self, arrays: Arrays, attributes: Attributes) -> None:
        super().__init__(arrays)
        self._arrays = arrays
        self._attributes = attributes

    def __getitem__(self, name: str) -> Array:
        array = self._arrays[name]
        if array.dtype.kind not in "fiub":
            return array
        unit, offset = self._unit(name, array), self._offset(name)
        if offset is None:
            return array if unit == 1.0 else Component(array, unit)
        shift = self._arrays[offset]
        return Component(array, unit, shift, self._unit(offset, shift))

    def _unit(self, name: str, array: Array) -> float:
        """Return the factor that makes SI units of an array's numbers."""
        found = (self._attributes(name, UNIT) or {}).get(UNIT)
        unit = found[0] if isinstance(found, list) and len(found) == 1 else found
        number = isinstance(unit, (int, float)) and not isinstance(unit, bool)
        if unit is None or not number or not math.isfinite(unit) or unit == 0:
            raise SceneError(
                f"{array.name}: found {UNIT}={unit!r:.40}, expected a number that makes SI units "
                "of it, as openPMD has it"
            )
        return float(unit)

    def _offset(self, name: str) -> str | None:
        """Return the path of the offset of a position; None if it has none that is not 0."""
        record, _, axis = name.rpartition("/")
        if record.rpartition("/")[2] != POSITION:
            return None
        offset = within(within(folder_of(record), OFFSET), axis)
        if offset not in self._arrays:
            return None
        constant = self._attributes(offset, "value") or {}
        return None if constant.get("value") in (0, [0]) else offset


class Component:
    """Presents a record component in SI units: a `bfrt.formats.table.Array` of float64.

    Parameters
    ----------
    array : Array
    unit : float
    offset : Array, optional
        What is added to it, number by number, in a unit of its own.
    offset_unit : float

    Raises
    ------
    SceneError
        If the offset's shape or type is another.
    """

    dtype: np.dtype[Any] = np.dtype("f8")

    def __init__(
        self, array: Array, unit: float, offset: Array | None = None, offset_unit: float = 1.0
    ) -> None:
        if offset is not None and (offset.shape != array.shape or offset.dtype.kind not in "fiub"):
            raise wrong(offset, f"numbers of shape {array.shape}, as what it is the offset of")
        self.name = array.name
        self.shape = array.shape
        self._array, self._unit = array, unit
        self._offset, self._offset_unit = offset, offset_unit

    def blocks(self, rows: int) -> Iterator[NDArray[Any]]:
        """Yield all rows, `rows` at a time."""
        scaled = (cast(block, np.float64) * self._unit for block in self._array.blocks(rows))
        if self._offset is None:
            yield from scaled
            return
        for block, offset in zip(scaled, self._offset.blocks(rows), strict=True):
            yield block + cast(offset, np.float64) * self._offset_unit

    def shallow(self) -> Component:
        """Return the array with one dimension less."""
        offset = None if self._offset is None else self._offset.shallow()
        return Component(self._array.shallow(), self._unit, offset, self._offset_unit)

    def frame(self, number: int) -> Component:
        """Return a frame of the array."""
        offset = None if self._offset is None else self._offset.frame(number)
        return Component(self._array.frame(number), self._unit, offset, self._offset_unit)
