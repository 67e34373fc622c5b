"""The views that pictures show, and their sampling."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

from bfrt.errors import SettingError
from bfrt.framing import check_one, framing_camera
from bfrt.illumination import AS_IT_IS, Illumination, LightAsked
from bfrt.image.frame import FrameSize
from bfrt.image.picture import Image
from bfrt.image.pictures import Images
from bfrt.records import ON_REQUEST
from bfrt.settings import at_least_one, chosen
from bfrt.store.model import MOST_PIXELS, Camera
from bfrt.store.store import Store

#: SPD's procedure: one ray at each pixel corner, five hits deep.
CORNERS = 0
DEPTH = 5

#: Samples of a pixel have numbers of 31 bits.
MOST_SAMPLES = (1 << 31) - 1

#: Elements of a film have numbers of 32 bits.
MOST_ELEMENTS = 1 << 32

#: What a caller asks for: a view, several of one size, or the scene's own.
Cameras = Camera | Sequence[Camera] | None


class View(NamedTuple):
    """Says from where a picture is taken, and in which light.

    Attributes
    ----------
    camera : Camera
    illumination : Illumination
    """

    camera: Camera
    illumination: Illumination


@dataclass(frozen=True)
class Views:
    """Describes views of a scene, of one size, that are rendered together: what changes pictures.

    Attributes
    ----------
    each : tuple of View
        One or more. But for lights that are added to a scene without any, all have one light.
    samples : int
        A pixel; 0 puts one at each pixel corner.
    depth : int
        Hits shaded along a path, the eye ray's included.
    aovs : tuple of str
        Which of `records.ON_REQUEST` the pictures have.
    """

    each: tuple[View, ...]
    samples: int
    depth: int
    aovs: tuple[str, ...]

    @classmethod
    def of(
        cls,
        store: Store,
        camera: Cameras,
        samples: int | None,
        depth: int,
        aovs: Sequence[str],
        light: LightAsked = AS_IT_IS,
    ) -> Views:
        """Check the views that a caller asks for, as in `bfrt.render`.

        Raises
        ------
        SettingError
            For the first that cannot be honoured; if there is no camera, and no object that one
            could frame.
        """
        cameras, light = cameras_of(store, camera), light.held()
        made = cls(
            each=tuple(View(each, Illumination.of(store, each, light)) for each in cameras),
            samples=CORNERS if samples is None else at_least_one("samples", samples, MOST_SAMPLES),
            depth=at_least_one("depth", depth),
            aovs=aovs_of(aovs),
        )
        if made.frame.elements > MOST_ELEMENTS:
            raise SettingError(
                f"camera: found {len(cameras)} views of {made.frame.elements} film elements, "
                f"expected {MOST_ELEMENTS} or fewer: render them by several calls"
            )
        return made

    @property
    def cameras(self) -> tuple[Camera, ...]:
        """Return the camera of each view."""
        return tuple(view.camera for view in self.each)

    @property
    def frame(self) -> FrameSize:
        """Return the size of the frame that the views lie in."""
        resolution = self.cameras[0].resolution
        return FrameSize(*resolution, self.samples, self.aovs, views=len(self.each))

    @property
    def illumination(self) -> Illumination:
        """Return what lights the first view: the others differ in where added lights are."""
        return self.each[0].illumination

    def sized(self, resolution: tuple[int, int] | None) -> Views:
        """Return the same views with another resolution, if one is given."""
        if resolution is None:
            return self
        return replace(
            self,
            each=tuple(
                view._replace(camera=replace(view.camera, resolution=resolution))
                for view in self.each
            ),
        )


def cameras_of(store: Store, asked: Cameras) -> tuple[Camera, ...]:
    """Return the cameras that a caller asks for, or the one that a scene has by default.

    Raises
    ------
    SettingError
        If there is none, what is given is none, or they have not one resolution.
    """
    if asked is None:
        return (store.camera or framing_camera(store),)
    cameras = (asked,) if isinstance(asked, Camera) else asked
    if not isinstance(cameras, Iterable):
        raise SettingError(f"camera: found {type(asked).__name__}, expected a Camera or None")
    cameras = tuple(cameras)
    if not cameras:
        raise SettingError("camera: found no cameras, expected one or more")
    for number, camera in enumerate(cameras):
        if not isinstance(camera, Camera):
            raise SettingError(
                f"camera: found {type(camera).__name__} at {number}, expected Cameras"
            )
        if tuple(camera.resolution) != tuple(cameras[0].resolution):
            raise SettingError(
                f"camera: found {camera.resolution} pixels at {number} and "
                f"{cameras[0].resolution} at 0, expected one resolution for all views"
            )
    return cameras


def preview_camera(store: Store, pixels: int, camera: Camera | None) -> Camera:
    """Return the view of a preview, as `Scene.preview` tells.

    Raises
    ------
    SettingError
        As `cameras_of`; if `pixels` is out of range.
    """
    check_one(camera)
    (view,) = cameras_of(store, camera)
    at_least_one("pixels", pixels, MOST_PIXELS)
    longer = max(view.resolution)
    width, height = (max(1, round(side * pixels / longer)) for side in view.resolution)
    return replace(view, resolution=(width, height))


def asked_for(images: Images, asked: Cameras) -> Image | Images:
    """Return what a caller has asked for: the picture of one view, or those of several."""
    return images[0] if asked is None or isinstance(asked, Camera) else images


def aovs_of(names: Sequence[str]) -> tuple[str, ...]:
    """Return the named channels of `records.ON_REQUEST`, in its order.

    Raises
    ------
    SettingError
        For a name that is none of them.
    """
    return chosen("aovs", names, ON_REQUEST)
