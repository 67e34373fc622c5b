"""What a scene has beside its objects: camera, lights, materials, background."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

from bfrt.errors import SceneError

Vector = tuple[float, float, float]


@dataclass(frozen=True)
class Camera:
    """Describes a pinhole camera, as NFF's ``v`` does.

    Parameters
    ----------
    eye, at, up : tuple of 3 float
        Where the eye is, what it looks at, and which way is up.
    angle : float
        Field of view in degrees from the bottom to the top of the image, in (0, 180).
    hither : float
        Distance of the hither plane. Kept; a ray tracer has no use for it.
    resolution : tuple of 2 int
        Width and height in pixels.

    Raises
    ------
    SceneError
        If the directions are degenerate or a value is out of range.
    """

    eye: Vector
    at: Vector
    up: Vector = (0.0, 0.0, 1.0)
    angle: float = 45.0
    hither: float = 1.0
    resolution: tuple[int, int] = (512, 512)

    def __post_init__(self) -> None:
        forward = [a - e for a, e in zip(self.at, self.eye, strict=True)]
        right = cross(forward, self.up)
        numbers = (*self.eye, *self.at, *self.up, self.angle, self.hither)
        if not all(math.isfinite(x) for x in numbers):
            raise SceneError(f"camera: found {numbers}, expected finite numbers")
        if not any(right):
            raise SceneError(
                f"camera: from {self.eye} at {self.at} up {self.up} does not span a view: "
                "expected three vectors that are neither zero nor parallel"
            )
        if not 0.0 < self.angle < 180.0:
            raise SceneError(f"camera: found angle {self.angle:g}, expected 0 < angle < 180")
        if not all(1 <= n <= 65535 for n in self.resolution):
            raise SceneError(
                f"camera: found resolution {self.resolution}, expected 1 to 65535 pixels an axis"
            )


class Light(NamedTuple):
    """Describes a point light."""

    position: Vector
    color: Vector = (1.0, 1.0, 1.0)


class Material(NamedTuple):
    """Describes a material, as NFF's ``f`` does."""

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
