"""Where the views of a frame are seen from, and in which light."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from bfrt.illumination import Illumination
from bfrt.phases.eye import view_vectors
from bfrt.store.model import Vector
from bfrt.view import Views


class Viewpoints(NamedTuple):
    """Tells from where each view of a frame is seen, and in which light.

    Attributes
    ----------
    eyes : (views, 3) float64
        Relative to the store's origin: Z is the distance from them.
    illuminations : tuple of Illumination
        That of each view; of one where all views have the same.
    across : int
        Film elements of a row of a view; the views lie side by side.
    """

    eyes: NDArray[np.float64]
    illuminations: tuple[Illumination, ...]
    across: int


def viewpoints_of(views: Views, origin: Vector) -> Viewpoints:
    """Return where views are seen from, relative to an origin, and in which light."""
    eyes = np.stack([view_vectors(camera, origin)[0] for camera in views.cameras])
    own = views.each if views.each[0].illumination.added else views.each[:1]
    return Viewpoints(
        eyes, tuple(view.illumination for view in own), views.frame.across // len(views.each)
    )
