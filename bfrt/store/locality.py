"""How near each other objects are that follow each other: whether their order is spatial."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from bfrt.store.extent import NOTHING, Bounds, bounds_of

#: Objects that are looked at together.
TOGETHER = 1 << 17

#: Windows' surfaces, as multiples of what they are in the best order, up to which an order is
#: local: along a Morton curve they are up to 2.5. In random order they are the number of windows
#: to the power 2/3; where that is little an order is local up to the part of it below, but for
#: the few windows of which each is a half of all.
FEWEST, MOST = 2.0, 3.0
OF_RANDOM = 0.5


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
    return max(FEWEST, min(MOST, OF_RANDOM * math.pow(windows, 2 / 3)))
