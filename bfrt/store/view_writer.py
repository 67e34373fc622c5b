"""What a scene has beside its objects: view, lights, background, where it is, what colors say."""

from __future__ import annotations

from dataclasses import asdict
from typing import Any

from bfrt.errors import SceneError
from bfrt.image.color_scale import ColorScale
from bfrt.store.given import triple_of
from bfrt.store.model import Camera, Light, Vector

#: Letters of a reference system's text, which is WKT at the longest.
MOST_TEXT = 1 << 20


class ViewWriter:
    """Takes the view, the lights, the background and the reference system of a store."""

    def __init__(self) -> None:
        self._camera: Camera | None = None
        self._lights: list[Light] = []
        self._background: Vector = (0.0, 0.0, 0.0)
        self._crs = ""
        self._colors: list[ColorScale] = []

    @property
    def view(self) -> dict[str, Any]:
        """Return what the header says of them: "crs" and "colors" only where there are any."""
        return {
            **({"crs": self._crs} if self._crs else {}),
            **({"colors": [scale._asdict() for scale in self._colors]} if self._colors else {}),
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
            If position or color are not three finite numbers, or it is another light: a store has
            point lights.
        """
        if not isinstance(light, Light):
            raise SceneError(
                f"light: found {light!r:.80}, expected a Light: others are for lights= of a render"
            )
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

    def color_scale(self, scale: ColorScale) -> None:
        """Add what colors say, which the store keeps for a picture's color bar.

        Parameters
        ----------
        scale : ColorScale
            Of some objects' colors. One that was added before is not added again.
        """
        if scale not in self._colors:
            self._colors.append(scale)

    def crs(self, crs: str) -> None:
        """Set the reference system of coordinates, which the store keeps and ``info`` tells.

        Parameters
        ----------
        crs : str
            As "EPSG:32632", or WKT; nothing is converted by it.

        Raises
        ------
        SceneError
            If it is not that which was set before: the coordinates of a store have one.
        """
        if not isinstance(crs, str) or not 0 < len(crs) < MOST_TEXT:
            raise SceneError(f"crs: found {crs!r:.60}, expected a text as EPSG:32632")
        if self._crs not in ("", crs):
            raise SceneError(
                f"crs: found {crs:.60}, expected {self._crs:.60}, as of what was before: reproject "
                "one of them"
            )
        self._crs = crs
