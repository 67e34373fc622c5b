"""Arrays of several frames, (frames, n, 3), of which one is read, as of H5MD.

H5MD has an element's frames as ``particles/GROUP/ELEMENT/value``. What belongs to positions has as
many frames as they.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from bfrt.errors import SceneError
from bfrt.formats.naming import VALUE, folder_of, within
from bfrt.formats.reading import Reading
from bfrt.formats.table import Array, Arrays, Listed

ELEMENT = "position"


class Framed(Listed):
    """Maps paths to arrays that become those of one frame where they have one dimension too many.

    Parameters
    ----------
    arrays : Mapping
    reading : Reading
    values_only : bool
        Whether only arrays named ``value`` have frames, and what others have are rows of a map.
    """

    def __init__(self, arrays: Arrays, reading: Reading, *, values_only: bool) -> None:
        super().__init__(arrays)
        self._arrays = arrays
        self._reading = reading
        self._values_only = values_only

    def __getitem__(self, name: str) -> Array:
        array = self._arrays[name]
        is_value = name.rpartition("/")[2] == VALUE
        if self._values_only and not is_value:
            return array
        return Frames(array, self._reading, self._positions(name) if is_value else None)

    def _positions(self, name: str) -> Array | None:
        """Return the positions that an element belongs to, of H5MD."""
        key = within(within(folder_of(folder_of(name)), ELEMENT), VALUE)
        return self._arrays[key] if key != name and key in self._arrays else None


class Frames:
    """Presents an array, of which one frame is taken: a `bfrt.formats.table.Array`.

    Parameters
    ----------
    array : Array
    reading : Reading
    positions : Array, optional
        An array that has as many frames.
    """

    def __init__(self, array: Array, reading: Reading, positions: Array | None) -> None:
        self.name = array.name
        self.shape = array.shape
        self.dtype: np.dtype[Any] = array.dtype
        self.blocks = array.blocks
        self._array, self._reading, self._positions = array, reading, positions

    def shallow(self) -> Array:
        """Return the frame that is asked for, or the last."""
        frame = self._reading.frame
        self._reading.uses.known.add("frame")
        return self.frame(-1 if frame is None else frame)

    def frame(self, number: int) -> Array:
        """Return a frame.

        Raises
        ------
        SceneError
            If the positions have more frames, or fewer.
        """
        if self._positions is not None and self._positions.shape[0] != self.shape[0]:
            raise SceneError(
                f"{self.name}: found {self.shape[0]} frames, expected {self._positions.shape[0]}, "
                "as the positions have"
            )
        return self._array.frame(number)
