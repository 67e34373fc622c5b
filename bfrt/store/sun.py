"""The sun: a light without a place, for pictures of terrains and towns."""

from __future__ import annotations

import math
from dataclasses import dataclass

from bfrt.errors import SceneError
from bfrt.settings import number_of
from bfrt.store.given import triple_of
from bfrt.store.model import Vector


@dataclass(frozen=True)
class Sun:
    """Describes a sun: parallel light from infinitely far, with shadows that do not end.

    It counts among the lights of a picture as a `Light` does, whose strength goes by their number.
    North is +y, east +x, and up +z, as on maps, whatever is up in the picture.

    Parameters
    ----------
    azimuth : float
        Where the sun is, in degrees clockwise from north: 90 is east.
    elevation : float
        Degrees above the horizon, -90 to 90. Below it, a terrain has no light of it.
    color : tuple of 3 float
        Linear RGB, relative, as of a `Light`.
    intensity : float
        What the color is multiplied by, 0 or more.

    Raises
    ------
    SceneError
        If a number is not finite or out of range.
    """

    azimuth: float
    elevation: float
    color: Vector = (1.0, 1.0, 1.0)
    intensity: float = 1.0

    def __post_init__(self) -> None:
        for name in ("azimuth", "elevation", "intensity"):
            object.__setattr__(self, name, _number(f"{name} of a sun", getattr(self, name)))
        object.__setattr__(self, "color", triple_of("color of a sun", self.color))
        if not -90.0 <= self.elevation <= 90.0:
            raise SceneError(f"elevation of a sun: found {self.elevation:g}, expected -90 to 90")
        if self.intensity < 0.0:
            raise SceneError(f"intensity of a sun: found {self.intensity:g}, expected 0 or more")

    @property
    def direction(self) -> Vector:
        """Return the unit vector to the sun; at multiples of 90 degrees it is an axis, exactly."""
        level = sine(90.0 - abs(self.elevation))
        return (
            level * sine(self.azimuth),
            level * sine(90.0 - self.azimuth),
            sine(self.elevation),
        )

    @property
    def strength(self) -> Vector:
        """Return the color times the intensity."""
        red, green, blue = self.color
        return red * self.intensity, green * self.intensity, blue * self.intensity


def sine(degrees: float) -> float:
    """Return the sine of an angle in degrees; that of multiples of 90 is exact."""
    turned = math.remainder(degrees, 360.0)
    if abs(turned) > 90.0:
        turned = math.copysign(180.0, turned) - turned
    return math.copysign(1.0, turned) if abs(turned) == 90.0 else math.sin(math.radians(turned))


def _number(name: str, value: float) -> float:
    number = number_of(value)
    if not math.isfinite(number):
        raise SceneError(f"{name}: found {value!r:.80}, expected a finite number")
    return number
