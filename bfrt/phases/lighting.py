"""Lights of a render, as the shading loop adds them up."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from bfrt.store.model import Light, Vector


class Lighting(NamedTuple):
    """Holds point lights and ambient light.

    Attributes
    ----------
    lights : ndarray of float64, shape (views, lights, 6)
        Position relative to the store's origin, and color times intensity: of each view, or of one
        where all have the same.
    ambient : float
        Intensity of the ambient light.
    """

    lights: NDArray[np.float64]
    ambient: float


def light_intensity(lights: int) -> float:
    """Return sqrt(n) / (2 n), the intensity of each of n lights and of ambient light (SPD)."""
    return math.sqrt(lights) / (2 * lights)


def lighting_of(lights: Sequence[Sequence[Light]], origin: Vector) -> Lighting:
    """Return lights of views, whose positions are in world coordinates, relative to an origin."""
    intensity = light_intensity(len(lights[0]))
    rows = [
        (*(np.array(light.position) - np.array(origin)), *(intensity * np.array(light.color)))
        for own in lights
        for light in own
    ]
    return Lighting(np.array(rows).reshape(len(lights), -1, 6), intensity)
