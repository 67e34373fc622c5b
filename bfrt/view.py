"""The view that a picture shows, and its sampling."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

from bfrt.errors import SettingError
from bfrt.framing import framing_camera
from bfrt.illumination import AS_IT_IS, Illumination, LightAsked
from bfrt.image.frame import FrameSize
from bfrt.records import ON_REQUEST
from bfrt.settings import at_least_one
from bfrt.store.model import Camera
from bfrt.store.store import Store

#: SPD's procedure: one ray at each pixel corner, five hits deep.
CORNERS = 0
DEPTH = 5

#: Samples of a pixel have numbers of 31 bits.
MOST_SAMPLES = (1 << 31) - 1


@dataclass(frozen=True)
class View:
    """Describes a view of a scene: what changes the picture.

    Attributes
    ----------
    camera : Camera
    illumination : Illumination
    samples : int
        A pixel; 0 puts one at each pixel corner.
    depth : int
        Hits shaded along a path, the eye ray's included.
    aovs : tuple of str
        Which of `records.ON_REQUEST` the picture has.
    """

    camera: Camera
    illumination: Illumination
    samples: int
    depth: int
    aovs: tuple[str, ...]

    @classmethod
    def of(
        cls,
        store: Store,
        camera: Camera | None,
        samples: int | None,
        depth: int,
        aovs: Sequence[str],
        light: LightAsked = AS_IT_IS,
    ) -> View:
        """Check the view that a caller asks for, as in `bfrt.render`.

        Raises
        ------
        SettingError
            For the first that cannot be honoured; if there is no camera, and no object that one
            could frame.
        """
        if camera is not None and not isinstance(camera, Camera):
            raise SettingError(f"camera: found {type(camera).__name__}, expected a Camera or None")
        camera = camera or store.camera or framing_camera(store)
        return cls(
            camera=camera,
            illumination=Illumination.of(store, camera, light),
            samples=CORNERS if samples is None else at_least_one("samples", samples, MOST_SAMPLES),
            depth=at_least_one("depth", depth),
            aovs=aovs_of(aovs),
        )

    @property
    def frame(self) -> FrameSize:
        """Return the size of the view's frame."""
        return FrameSize(*self.camera.resolution, self.samples, self.aovs)

    def sized(self, resolution: tuple[int, int] | None) -> View:
        """Return the same view with another resolution, if one is given."""
        if resolution is None:
            return self
        return replace(self, camera=replace(self.camera, resolution=resolution))


def aovs_of(names: Sequence[str]) -> tuple[str, ...]:
    """Return the named channels of `records.ON_REQUEST`, in its order.

    Raises
    ------
    SettingError
        For a name that is none of them.
    """
    if not isinstance(names, Iterable):
        raise SettingError(
            f"aovs: found {names!r:.80}, expected a sequence of {', '.join(ON_REQUEST)}"
        )
    unknown = [name for name in names if name not in ON_REQUEST]
    if unknown or isinstance(names, str):
        found = repr(names if isinstance(names, str) else unknown[0])
        raise SettingError(f"aovs: found {found}, expected a sequence of {', '.join(ON_REQUEST)}")
    return tuple(name for name in ON_REQUEST if name in names)
