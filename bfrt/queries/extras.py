"""What `bfrt.cast_rays` tells of a hit where it is asked for: the place, and one beside it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from bfrt.errors import SettingError
from bfrt.queries.answers import Fields
from bfrt.settings import chosen

#: The keys, of which a miss has inf.
EXTRA_FIELDS: Fields = {
    "positions": (np.float64, (3,)),
    "next_origins": (np.float64, (3,)),
}

#: The sides of a surface, by the numbers that ``bfrt/geometry/departure.pxd`` has for them.
SIDES = ("incoming", "opposite", "front", "back")


class Extras(NamedTuple):
    """Names the keys that are asked for, and the side that rays leave to.

    Attributes
    ----------
    keys : tuple of str
        Of `EXTRA_FIELDS`.
    side : int
        The place in `SIDES`.
    """

    keys: tuple[str, ...] = ()
    side: int = 0

    @classmethod
    def of(cls, outputs: Sequence[str], side: str) -> Extras:
        """Check what a caller asks for.

        Raises
        ------
        SettingError
            For a key or a side that there is not.
        """
        keys = chosen("outputs", outputs, EXTRA_FIELDS)
        if not isinstance(side, str) or side not in SIDES:
            raise SettingError(f"side: found {side!r:.80}, expected one of {', '.join(SIDES)}")
        return cls(keys, SIDES.index(side))

    @property
    def fields(self) -> Fields:
        """Return the fields that are asked for."""
        return {key: EXTRA_FIELDS[key] for key in self.keys}

    def record(self, plain: np.dtype[Any]) -> np.dtype[Any]:
        """Return the type of a record that has them too."""
        return np.dtype([*plain.descr, *((key, "<f8", 3) for key in self.keys)])

    def missed(self, plain: NDArray[Any]) -> NDArray[Any]:
        """Return the record of a miss, (1,), that has them too."""
        made = np.zeros(1, self.record(plain.dtype))
        for name in plain.dtype.names or ():
            made[name] = plain[name]
        for key in self.keys:
            made[key] = np.inf
        return made


#: Nothing else is asked for.
NO_EXTRAS = Extras()
