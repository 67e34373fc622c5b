"""Where the views of a film are seen from, and in which light."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from bfrt.phases.eye import view_vectors
from bfrt.store.model import Light, Vector
from bfrt.view import Views

#: Where the views of elements follow from their numbers.
FOLLOWING = np.zeros(0, np.int32)


class Viewpoints(NamedTuple):
    """Tells of each element of a film from where it is seen, and in which light.

    Attributes
    ----------
    eyes : (views, 3) float64
        Relative to the store's origin: Z is the distance from them.
    lights : tuple of tuple of Light
        Those of each view, in world coordinates; of one where all views have the same.
    across : int
        Film elements of a row of a view; the views lie side by side.
    numbers : (elements,) int32
        The view of each element, where a film has some elements only; none where it has all.
    """

    eyes: NDArray[np.float64]
    lights: tuple[tuple[Light, ...], ...]
    across: int
    numbers: NDArray[np.int32] = FOLLOWING

    def of_some(self, elements: NDArray[np.uint32]) -> Viewpoints:
        """Return the same for a film of some elements, by their numbers in the whole one."""
        if len(self.eyes) == 1:
            return self
        lines = elements // np.uint32(self.across)
        return self._replace(numbers=(lines % np.uint32(len(self.eyes))).astype(np.int32))


def viewpoints_of(views: Views, origin: Vector) -> Viewpoints:
    """Return where views are seen from, relative to an origin, and in which light."""
    eyes = np.stack([view_vectors(camera, origin)[0] for camera in views.cameras])
    lit = views.each if views.each[0].added else views.each[:1]
    lights = tuple(tuple(view.lights) for view in lit)
    return Viewpoints(eyes, lights, views.frame.across // len(views.each))
