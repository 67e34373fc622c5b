"""Records as bytes that travel: packed where that makes them less."""

from __future__ import annotations

import zlib
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

#: Rays of a block: 5.8 MB.
BLOCK = 65536

#: Bytes that are packed to see whether it pays, and the most that may be left of them.
SAMPLE = 1 << 15
PAYS = 0.8

#: Speed matters more than size.
LEVEL = 1


@dataclass(frozen=True)
class Cargo:
    """Holds records as they travel.

    Attributes
    ----------
    data : bytes
    packed : bool
        Whether they are packed, by zlib, byte by byte of all records.
    """

    data: bytes
    packed: bool

    @classmethod
    def of(cls, records: NDArray[Any]) -> Cargo:
        """Pack records (n,), if it pays: the first bytes of all, then the second ..."""
        plain = records.tobytes()
        some = plain[: SAMPLE // records.itemsize * records.itemsize]
        if len(zlib.compress(_turned(some, records.itemsize), LEVEL)) > PAYS * len(some):
            return cls(plain, packed=False)
        return cls(zlib.compress(_turned(plain, records.itemsize), LEVEL), packed=True)

    def records(self, dtype: np.dtype[Any]) -> NDArray[Any]:
        """Return the records, a new array."""
        data = self.data
        if self.packed:
            turned = np.frombuffer(zlib.decompress(data), np.uint8)
            data = turned.reshape(dtype.itemsize, -1).T.tobytes()
        return np.frombuffer(data, dtype).copy()

    def __len__(self) -> int:
        """Return the bytes that travel."""
        return len(self.data)


def _turned(data: bytes, size: int) -> bytes:
    return np.frombuffer(data, np.uint8).reshape(-1, size).T.tobytes()
