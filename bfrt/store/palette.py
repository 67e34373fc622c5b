"""The palette as it is written: each material once, and the indices by which objects name one."""

from __future__ import annotations

from collections import OrderedDict
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from bfrt.errors import SceneError
from bfrt.records import MATERIAL
from bfrt.store.given import array_of
from bfrt.store.header import facts_of
from bfrt.store.model import Material
from bfrt.streams.writer import FileWriter

#: Distinct materials that are remembered, so that a repeated one is stored once.
REMEMBERED = 65536


#: Numbers of a material that tell it from others.
KEY_NUMBERS = 8


class SavedPalette(NamedTuple):
    """Holds what a palette's writer has in memory.

    Attributes
    ----------
    bytes, crc32 : int
        Length and checksum of the file.
    keys : (n, KEY_NUMBERS) float64
        The materials that are remembered, the latest last.
    """

    bytes: int
    crc32: int
    keys: NDArray[np.float64]


def record_of(material: Material) -> NDArray[Any]:
    """Return a material as it is stored, (1,) of records.MATERIAL.

    Raises
    ------
    SceneError
        If a number is negative, or not finite as float32.
    """
    with np.errstate(over="ignore"):  # infinity is refused
        record = np.array([(*material.color, *material[1:])], MATERIAL)
    numbers = record.view("<f4")
    if not np.isfinite(numbers).all() or (numbers < 0).any():
        raise SceneError(f"material: found {material}, expected finite numbers, none negative")
    return record


def key_of(material: Material) -> bytes:
    """Return what materials that are equal have in common: their numbers, float64.

    It takes a sixth of the memory that a `Material` does.
    """
    return np.array([*material.color, *material[1:]], np.float64).tobytes()


class PaletteWriter:
    """Writes the palette's file.

    Attributes
    ----------
    count : int
        Number of materials so far.
    """

    def __init__(self, path: Path, durable: bool, saved: SavedPalette | None = None) -> None:
        self.count = 0
        self._remembered: OrderedDict[bytes, int] = OrderedDict()
        behind = None
        if saved is not None:
            self.count = saved.bytes // MATERIAL.itemsize
            # They were added one after another, and none but the oldest has been forgotten.
            first = self.count - len(saved.keys)
            self._remembered.update((key.tobytes(), first + k) for k, key in enumerate(saved.keys))
            behind = (saved.bytes, saved.crc32)
        self._file = FileWriter(path, durable, behind)

    def saved(self) -> SavedPalette:
        """Have all materials so far on the disk; return what brings the writer back to here."""
        self._file.sync()
        keys = np.frombuffer(b"".join(self._remembered), np.float64).reshape(-1, KEY_NUMBERS)
        return SavedPalette(self._file.bytes, self._file.checksum, keys)

    def find(self, material: Material) -> int | None:
        """Return the index of a material that equals one of the last `REMEMBERED`, or None."""
        return self._remembered.get(key_of(material))

    def add(self, material: Material, record: NDArray[Any]) -> int:
        """Write a material, whose `record_of` is given; return its index."""
        self._file.write(record.view(np.uint8))
        index = self.count
        self.count += 1
        self._remembered[key_of(material)] = index
        if len(self._remembered) > REMEMBERED:
            self._remembered.popitem(last=False)
        return index

    def indices_of(self, materials: ArrayLike, n: int) -> NDArray[np.uint32]:
        """Return a caller's index for all of n objects, or for each, as (n,) indices.

        Raises
        ------
        SceneError
            If they are not integers of this shape, or there is no such material.
        """
        given = array_of("materials", materials)
        indices = np.broadcast_to(given, (n,)) if given.ndim == 0 else given
        if indices.shape != (n,) or indices.dtype.kind not in "iu":
            raise SceneError(
                f"materials: found {indices.dtype} of shape {indices.shape}, "
                f"expected one integer or ({n},) of them"
            )
        low, high = (int(indices.min()), int(indices.max())) if n else (0, -1)
        if low < 0 or high >= self.count:
            raise SceneError(
                f"materials: found index {low if low < 0 else high}, "
                f"expected 0 to {self.count - 1}: add materials first"
            )
        return indices.astype(np.uint32, copy=False)

    def forget(self) -> None:
        """Give back the memory of materials that may come again, for none will."""
        self._remembered.clear()

    def close(self) -> dict[str, int]:
        """Make the file durable; return what the header says of it."""
        self._file.close()
        return facts_of(self._file)

    def abandon(self) -> None:
        """Give the file up."""
        self._file.abandon()
