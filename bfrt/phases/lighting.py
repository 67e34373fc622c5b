"""Lights of a render, as the shading loop adds them up."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from bfrt.illumination import Illumination, light_intensity
from bfrt.store.model import Light
from bfrt.store.store import Store
from bfrt.store.sun import Sun

#: Of the diagonal of the scene's bounds: from any place of the scene this is beyond all of it.
BEYOND = 2.0

#: From farther away light is parallel as a sun's: squares of such lengths are no numbers any more.
FAR = 2.0**500


class Lighting(NamedTuple):
    """Holds lights and ambient light.

    Attributes
    ----------
    lights : ndarray of float64, shape (views, lights, 7)
        Place, in homogeneous coordinates relative to the store's origin, and color times intensity:
        of each view, or of one where all have the same. A point light has w = 1; a sun w = 0, and
        the vector to it is so long that it ends beyond the scene.
    ambient : float
        Intensity of the ambient light.
    rays : int
        Of ambient occlusion, that an eye hit sends; 0 for none.
    reach : float
        The length of these rays, which is no more than what is beyond the scene.
    """

    lights: NDArray[np.float64]
    ambient: float
    rays: int
    reach: float


def lighting_of(store: Store, each: Sequence[Illumination]) -> Lighting:
    """Return what lights the views of a scene, relative to the store's origin."""
    beyond = BEYOND * store.bounds.diagonal
    one = each[0]
    intensity = light_intensity(len(one.lights))
    rows = [
        (*_place_of(light, store, beyond), *(intensity * np.array(_strength_of(light))))
        for illumination in each
        for light in illumination.lights
    ]
    return Lighting(
        np.array(rows, np.float64).reshape(len(each), len(one.lights), 7),
        one.ambient,
        one.ao,
        min(one.ao_distance, beyond),
    )


def _place_of(light: Light | Sun, store: Store, beyond: float) -> tuple[float, ...]:
    """Return x, y, z and w of a light."""
    if isinstance(light, Sun):
        return (*(beyond * np.array(light.direction)), 0.0)
    place = np.array(light.position) - np.array(store.origin)
    size = float(np.abs(place).max())
    if size > FAR:
        way = place / size
        return (*(beyond / float(np.sqrt(way @ way)) * way), 0.0)
    return (*place, 1.0)


def _strength_of(light: Light | Sun) -> tuple[float, ...]:
    return light.strength if isinstance(light, Sun) else light.color
