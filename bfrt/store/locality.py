"""How near each other objects are that follow each other: whether their order is spatial."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from bfrt.store.extent import NOTHING, Bounds, bounds_of

#: Objects that are looked at together.
TOGETHER = 1 << 17

#: Windows' surfaces, as multiples of what they are in the best order, up to which an order is
#: local: for so few windows that little can be told, and for many.
FEW, MANY = 2.0, 3.0

#: In random order they are the number of windows to this power: each window's are those of all.
#: (Along a Morton curve they were 1.1 to 2.4, of 2 to 1,000 windows; in random order 2.4 of 4, 3.8
#: of 8, 15 of 64.) A half of that is no more local.
OF_RANDOM, RANDOM_PART = 2 / 3, 0.5


class Locality:
    """Measures the order of a stream's objects, as they come.

    The boxes around runs of TOGETHER objects are compared with cubes that fill the box around all:
    runs of objects that lie together have about the surface of those, and of objects in random
    order that of all.
    """

    def __init__(self) -> None:
        self._surfaces = 0.0
        self._windows = 0
        self._all = NOTHING
        self._window = NOTHING
        self._held = 0

    def add(self, boxes: NDArray[np.float32]) -> None:
        """Take the boxes of the next objects, (n, 6)."""
        first = 0
        while first < len(boxes):
            last = min(len(boxes), first + TOGETHER - self._held)
            self._window = self._window.union(bounds_of(boxes[first:last]))
            self._held += last - first
            if self._held == TOGETHER:
                self._turn()
            first = last

    def _turn(self) -> None:
        self._surfaces += self._window.surface
        self._windows += 1
        self._all = self._all.union(self._window)
        self._window, self._held = NOTHING, 0

    @property
    def local(self) -> bool:
        """Tell whether the order so far is local."""
        windows = self._windows + (self._held > 0)
        whole: Bounds = self._all.union(self._window)
        surfaces = self._surfaces + self._window.surface
        best = whole.surface * windows ** (1 / 3)
        return bool(surfaces <= threshold(windows) * best)


def threshold(windows: int) -> float:
    """Return the multiple of the best surfaces of so many windows up to which an order is local."""
    return max(FEW, min(MANY, RANDOM_PART * math.pow(windows, OF_RANDOM)))
