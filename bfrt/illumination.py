"""What lights a picture: its lights, the ambient light, and what is behind all objects."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np

from bfrt.errors import SceneError, SettingError
from bfrt.framing import framing_lights
from bfrt.settings import at_least_one, number_of
from bfrt.store.given import triple_of
from bfrt.store.model import Camera, Light, Vector
from bfrt.store.store import Store
from bfrt.store.sun import Sun

#: Rays of ambient occlusion that a hit sends at the most.
MOST_OCCLUSION_RAYS = 1 << 16

#: The least distance that they may go: the square of less is no number any more.
LEAST_DISTANCE = 1e-150


@dataclass(frozen=True)
class LightAsked:
    """Holds what a caller asks for, as in `bfrt.render`, unchecked.

    Attributes
    ----------
    lights : sequence of Light and Sun, optional
    ambient : float, optional
    ao : int
    ao_distance : float, optional
    background : tuple of 3 float, optional
    """

    lights: Sequence[Light | Sun] | None = None
    ambient: float | None = None
    ao: int = 0
    ao_distance: float | None = None
    background: Vector | None = None

    def held(self) -> LightAsked:
        """Return the same with lights that can be gone through again, for each view."""
        return self if self.lights is None else replace(self, lights=lights_of(self.lights))


#: Nothing: all is the scene's.
AS_IT_IS = LightAsked()


@dataclass(frozen=True)
class Illumination:
    """Describes what lights a picture.

    Attributes
    ----------
    lights : tuple of Light and Sun
        Those asked for, or the scene's, or those that were added to it.
    added : tuple of Light
        The latter, where the scene has none and none are asked for.
    ambient : float
        The intensity of the ambient light.
    ao : int
        Rays by which an eye hit finds out how open it is to the ambient light; 0 is no occlusion.
    ao_distance : float
        The length of these rays, world units; inf for all of the scene.
    background : tuple of 3 float
        The color of rays that meet nothing, linear RGB.
    """

    lights: tuple[Light | Sun, ...]
    added: tuple[Light, ...]
    ambient: float
    ao: int
    ao_distance: float
    background: Vector

    @classmethod
    def of(cls, store: Store, camera: Camera, asked: LightAsked) -> Illumination:
        """Check what a caller asks for.

        Raises
        ------
        SettingError
            For the first that cannot be honoured.
        """
        lights = None if asked.lights is None else lights_of(asked.lights)
        added: tuple[Light, ...] = ()
        if lights is None:
            added = () if store.lights else tuple(framing_lights(store, camera))
            lights = (*store.lights, *added)
        ao, distance = occlusion_of(asked)
        return cls(
            lights=lights,
            added=added,
            ambient=(
                light_intensity(len(lights)) if asked.ambient is None else ambient_of(asked.ambient)
            ),
            ao=ao,
            ao_distance=distance,
            background=(
                store.background if asked.background is None else background_of(asked.background)
            ),
        )

    @property
    def shadow_rays(self) -> int:
        """Return the number of rays that a hit sends at the most to find out what lights it."""
        return len(self.lights) + self.ao

    def facts(self) -> dict[str, Any]:
        """Return all that changes the picture, ready for JSON."""
        return {
            "lights": [asdict(light) if isinstance(light, Sun) else light for light in self.lights],
            "ambient": self.ambient,
            "ao": self.ao,
            "ao_distance": self.ao_distance if math.isfinite(self.ao_distance) else None,
            "background": self.background,
        }


def light_intensity(lights: int) -> float:
    """Return sqrt(n) / (2 n), the intensity of each of n lights and of ambient light (SPD).

    Without lights, of which SPD does not speak, the ambient light has 1.
    """
    return math.sqrt(lights) / (2 * lights) if lights else 1.0


def lights_of(given: Sequence[Light | Sun]) -> tuple[Light | Sun, ...]:
    """Return the lights that a caller gives."""
    if not isinstance(given, Iterable) or isinstance(given, (str, Light)):
        raise SettingError(f"lights: found {given!r:.80}, expected a sequence of Light and Sun")
    return tuple(_light_of(light) for light in given)


def _light_of(given: Light | Sun) -> Light | Sun:
    if isinstance(given, Sun):
        return given
    if not isinstance(given, Light):
        raise SettingError(f"lights: found {given!r:.80} among them, expected a Light or a Sun")
    try:
        return Light(triple_of("position", given.position), triple_of("color", given.color))
    except SceneError as error:
        raise SettingError(f"lights: {error}") from None


def ambient_of(given: float) -> float:
    """Return the intensity of the ambient light that a caller gives."""
    intensity = number_of(given)
    if not 0.0 <= intensity < math.inf:
        raise SettingError(f"ambient: found {given!r:.80}, expected a number of 0 or more")
    return intensity


def occlusion_of(asked: LightAsked) -> tuple[int, float]:
    """Return the rays of ambient occlusion that a caller asks for, and their length."""
    ao, distance = asked.ao, asked.ao_distance
    if isinstance(ao, bool) or not isinstance(ao, (int, np.integer)) or ao < 0:
        raise SettingError(f"ao: found {ao!r:.80}, expected a whole number of 0 or more")
    if ao:
        at_least_one("ao", ao, MOST_OCCLUSION_RAYS)
    if distance is None:
        return int(ao), math.inf
    if not ao:
        raise SettingError(f"ao_distance: found {distance!r:.80} without ao, which it is of")
    length = number_of(distance)
    if not length >= LEAST_DISTANCE:
        raise SettingError(
            f"ao_distance: found {distance!r:.80}, expected a length of {LEAST_DISTANCE:g} or more"
        )
    return int(ao), length


def background_of(given: Vector) -> Vector:
    """Return the background that a caller gives."""
    try:
        return triple_of("background", given)
    except SceneError as error:
        raise SettingError(str(error)) from None
