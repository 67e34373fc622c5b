"""What a scene has beside its objects: its view, its lights and its background, as they are set."""

from __future__ import annotations

from dataclasses import asdict
from typing import Any

from bfrt.store.given import triple_of
from bfrt.store.model import Camera, Light, Vector


class ViewWriter:
    """Takes the view, the lights and the background of a store."""

    def __init__(self) -> None:
        self._camera: Camera | None = None
        self._lights: list[Light] = []
        self._background: Vector = (0.0, 0.0, 0.0)

    @property
    def view(self) -> dict[str, Any]:
        """Return what the header says of them."""
        return {
            "camera": None if self._camera is None else asdict(self._camera),
            "lights": self._lights,
            "background": self._background,
        }

    def camera(self, camera: Camera) -> None:
        """Set the view that is rendered where the caller gives no other.

        Parameters
        ----------
        camera : Camera
            In world coordinates. A second call replaces the first.

        Raises
        ------
        SceneError
            If a vector is not three finite numbers, or a value is out of range.
        """
        self._camera = Camera(
            triple_of("eye", camera.eye),
            triple_of("at", camera.at),
            triple_of("up", camera.up),
            float(camera.angle),
            float(camera.hither),
            (int(camera.resolution[0]), int(camera.resolution[1])),
        )

    def light(self, light: Light) -> None:
        """Add a point light.

        Parameters
        ----------
        light : Light
            Position in world coordinates, and relative color.

        Raises
        ------
        SceneError
            If position or color are not three finite numbers.
        """
        self._lights.append(
            Light(triple_of("light", light.position), triple_of("color of a light", light.color))
        )

    def background(self, color: Vector) -> None:
        """Set the color of rays that meet nothing.

        Parameters
        ----------
        color : (3,) array_like
            Linear RGB. A scene without a call has black, (0, 0, 0).

        Raises
        ------
        SceneError
            If the color is not three finite numbers.
        """
        self._background = triple_of("background", color)
