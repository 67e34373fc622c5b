"""The parts of a scene beside its objects: camera, lights and materials."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from bfrt.errors import SceneError
from bfrt.settings import number_of
from bfrt.store.given import triple_of

Vector = tuple[float, float, float]

#: Pixels of a side of a picture.
MOST_PIXELS = 65535


@dataclass(frozen=True)
class Camera:
    """Describes a pinhole camera, as NFF's ``v`` does.

    Parameters
    ----------
    eye, at : tuple of 3 float
        Where the eye is and the point it looks at, world coordinates.
    up : tuple of 3 float
        The direction that is up in the image; of any length, not along the view. By default +z.
    angle : float
        Vertical field of view, from the bottom to the top of the image, in degrees, in (0, 180).
        The horizontal one follows from the resolution: pixels are square.
    hither : float
        Distance of NFF's hither plane, world units. It is kept and not used: nothing is clipped.
    resolution : tuple of 2 int
        Width and height in pixels, 1 to 65535 each.

    Raises
    ------
    SceneError
        If a number is not finite or out of range, or if eye, at and up do not span a view.
    """

    eye: Vector
    at: Vector
    up: Vector = (0.0, 0.0, 1.0)
    angle: float = 45.0
    hither: float = 1.0
    resolution: tuple[int, int] = (512, 512)

    def __post_init__(self) -> None:
        for name in ("eye", "at", "up"):
            object.__setattr__(self, name, triple_of(f"camera: {name}", getattr(self, name)))
        for name in ("angle", "hither"):
            given = getattr(self, name)
            if not math.isfinite(number_of(given)):
                raise SceneError(f"camera: found {name} {given!r:.80}, expected a finite number")
            object.__setattr__(self, name, number_of(given))
        object.__setattr__(self, "resolution", pixels_of(self.resolution))
        forward = [a - e for a, e in zip(self.at, self.eye, strict=True)]
        if not any(cross(forward, self.up)):
            raise SceneError(
                f"camera: from {self.eye} at {self.at} up {self.up} does not span a view: "
                "expected three vectors that are neither zero nor parallel"
            )
        if not 0.0 < self.angle < 180.0:
            raise SceneError(f"camera: found angle {self.angle:g}, expected 0 < angle < 180")


def pixels_of(given: Sequence[int]) -> tuple[int, int]:
    """Return a resolution: width and height."""
    sides = tuple(given) if isinstance(given, Iterable) else ()
    whole = all(isinstance(n, (int, np.integer)) and not isinstance(n, bool) for n in sides)
    if len(sides) != 2 or not whole or not all(1 <= n <= MOST_PIXELS for n in sides):
        raise SceneError(
            f"camera: found resolution {given!s:.80}, expected 1 to {MOST_PIXELS} pixels an axis"
        )
    return int(sides[0]), int(sides[1])


class Light(NamedTuple):
    """Describes a point light.

    Its light does not weaken with distance. With n lights a scene takes each color times
    sqrt(n) / (2 n), and white times as much for the ambient light, as the SPD text offers: two
    white lights have an intensity of 0.35 each.

    Parameters
    ----------
    position : tuple of 3 float
        Where the light is, world coordinates.
    color : tuple of 3 float
        Linear RGB, relative: (1, 1, 1), the default, is white of full strength.
    """

    position: Vector
    color: Vector = (1.0, 1.0, 1.0)


class Material(NamedTuple):
    """Describes a material, as NFF's ``f`` does.

    All numbers are 0 or more, and are stored as float32. `SceneWriter.material` refuses others.

    Parameters
    ----------
    color : tuple of 3 float
        Linear RGB, usually 0 to 1. It colors the diffuse and the ambient light.
    kd : float
        Part of the light that is scattered (Lambert); the ambient light is scattered likewise.
    ks : float
        Part of the light that is mirrored. A surface with ks > 0 is a mirror: each hit sends a
        reflection ray of weight `ks`. Lights make a highlight of this strength in their own color.
    shine : float
        Phong's exponent of the highlight; larger is smaller and sharper.
    transmittance : float
        Part of the light that passes through. A hit on a surface with transmittance > 0 sends a
        refraction ray of this weight, and a reflection ray of weight `ks`; in total internal
        reflection the latter takes both weights.
    ior : float
        Index of refraction inside; 0, as SPD writes it for opaque objects, counts as 1.
    """

    color: Vector = (0.8, 0.8, 0.8)
    kd: float = 1.0
    ks: float = 0.0
    shine: float = 1.0
    transmittance: float = 0.0
    ior: float = 1.0


def cross(a: list[float] | Vector, b: list[float] | Vector) -> Vector:
    """Return the cross product of two 3-vectors."""
    return (
        a[1] * b[2] - a[2] * b[1],
        a[2] * b[0] - a[0] * b[2],
        a[0] * b[1] - a[1] * b[0],
    )
