"""How near each other objects are that follow each other: whether their order is spatial."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from bfrt.store.extent import NOTHING, Bounds, bounds_of

#: Objects that are looked at together.
TOGETHER = 1 << 17

#: Windows' surfaces, as multiples of what they are in the best order, up to which an order is
#: local.
LOCAL = 2.0


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
        return bool(surfaces <= LOCAL * whole.surface * windows ** (1 / 3))
