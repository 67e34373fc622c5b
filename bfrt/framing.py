"""A camera and lights for a scene that has none, made from its bounds; views around a scene.

::

             up                eye
              |             .'           the eye is 1 to the right, 2 to the front and 1 up;
           .--|--.       .'              so far that the sphere around the bounds is seen whole:
          (  at   )   .'
           '-----' .'                    distance = radius / sin(half the smaller angle of view)
         front

Nothing here is random: the same scene, seen in the same resolution, is the same picture.
"""

from __future__ import annotations

import math
from dataclasses import replace

from bfrt.errors import SceneError, SettingError
from bfrt.settings import at_least_one
from bfrt.store.given import triple_of
from bfrt.store.model import Camera, Light, Vector, cross
from bfrt.store.store import Store

#: Views of a turn at the most.
MOST_VIEWS = 65536

#: From the scene to the eye, in parts of right, front and up.
TO_EYE = (1.0, 2.0, 1.0)

#: From the eye to each light, in parts of right, up and back, and the light's color. The key light
#: comes over the left shoulder, 38 degrees high for the framing camera, as a map's relief is
#: shaded; the fill, from the right, is a third as bright. The colors add up to 2, so that the
#: lights together are as bright as any other two.
KEY = ((-1.25, 0.75, 0.5), 1.5)
FILL = ((1.0, 0.25, 0.0), 0.5)


def framing_camera(
    store: Store,
    *,
    eye: Vector | None = None,
    at: Vector | None = None,
    up: Vector = Camera.up,
    angle: float = Camera.angle,
    resolution: tuple[int, int] = Camera.resolution,
) -> Camera:
    """Return the camera that frames a store's bounds, as `bfrt.Scene.framing_camera` does."""
    view = Camera(way_to_eye(up), (0.0, 0.0, 0.0), up, angle, resolution=resolution)
    if eye is not None and at is not None:
        return replace(view, eye=eye, at=at)
    center, radius = bounding_sphere(store)
    if radius == 0.0:
        raise SettingError(
            f"{store.path}: found no camera and no extent that one could frame, "
            "expected a camera, or objects"
        )
    distance = radius / math.sin(half_angle(view))
    return replace(
        view,
        eye=moved(center, distance, view.eye) if eye is None else eye,
        at=center if at is None else at,
    )


def turntable(store: Store, count: int, camera: Camera | None = None) -> list[Camera]:
    """Return views around a store's bounds, as `bfrt.Scene.turntable` does."""
    at_least_one("count", count, MOST_VIEWS)
    check_one(camera)
    first = camera or store.camera or framing_camera(store)
    center, _ = bounding_sphere(store)
    axis = unit(first.up)

    def turned(point: Vector, angle: float) -> Vector:
        """Turn a point about the axis through the center (Rodrigues)."""
        way = moved(point, -1.0, center)
        along = axis[0] * way[0] + axis[1] * way[1] + axis[2] * way[2]
        aside = moved(way, -along, axis)
        onward = cross(axis, aside)
        on_axis = moved(center, along, axis)
        return moved(moved(on_axis, math.cos(angle), aside), math.sin(angle), onward)

    angles = (2.0 * math.pi * number / count for number in range(1, count))
    others = ((turned(first.eye, angle), turned(first.at, angle)) for angle in angles)
    return [first, *(replace(first, eye=eye, at=at) for eye, at in others)]


def check_one(camera: object) -> None:
    """Refuse what is neither a camera nor None, as several cameras are."""
    if camera is not None and not isinstance(camera, Camera):
        raise SettingError(f"camera: found {type(camera).__name__}, expected a Camera or None")


def framing_lights(store: Store, camera: Camera) -> list[Light]:
    """Return two lights for a scene that has none: `KEY` and `FILL`.

    Each light is at ``eye + size (x right + y up + z back)``, along the camera's axes. The size is
    the eye's distance from the center of the bounds, or their radius if that is more: so light
    falls at the same angles on a scene that is seen whole, from near or far, and on the part of it
    that an eye inside the scene sees.

    Parameters
    ----------
    store : Store
    camera : Camera
        The view to light.

    Returns
    -------
    list of Light
    """
    center, radius = bounding_sphere(store)
    size = max(radius, length(moved(camera.eye, -1.0, center)))
    lights = []
    for parts, brightness in (KEY, FILL):
        position = camera.eye
        for part, axis in zip(parts, axes_of(camera), strict=True):
            position = moved(position, size * part, axis)
        lights.append(Light(position, (brightness,) * 3))
    return lights


def bounding_sphere(store: Store) -> tuple[Vector, float]:
    """Return the center (world coordinates) and the radius of the sphere around the bounds.

    ``(lo + hi) / 2 + origin``, and ``|hi - lo| / 2``; the origin and 0 where there are no objects.
    """
    if store.bounds.empty:
        return store.origin, 0.0
    x, y, z = (float(c) for c in (store.bounds.lo + store.bounds.hi) / 2)
    return moved(store.origin, 1.0, (x, y, z)), store.bounds.diagonal / 2


def half_angle(camera: Camera) -> float:
    """Return half the smaller angle of view, in radians.

    The vertical one is ``angle``, the horizontal one ``2 atan(tan(angle / 2) width / height)``.
    """
    width, height = camera.resolution
    half = math.radians(camera.angle) / 2
    return half if width >= height else math.atan(math.tan(half) * width / height)


def way_to_eye(up: Vector) -> Vector:
    """Return the unit direction to the eye: `TO_EYE` in axes that `up` decides.

    ``front = x cross up``, or ``y cross up`` where `up` is along x more than y and z;
    ``right = up cross front``.
    """
    try:
        above = unit(triple_of("up", up))
    except SceneError as error:
        raise SettingError(str(error)) from None
    if not any(above):
        raise SettingError(f"up: found {up}, expected finite numbers that are not all zero")
    x, y, z = (abs(part) for part in above)
    aside = (0.0, 1.0, 0.0) if x > max(y, z) else (1.0, 0.0, 0.0)
    front = unit(cross(aside, above))
    way = (0.0, 0.0, 0.0)
    for part, axis in zip(TO_EYE, (cross(above, front), front, above), strict=True):
        way = moved(way, part, axis)
    return unit(way)


def axes_of(camera: Camera) -> tuple[Vector, Vector, Vector]:
    """Return the unit vectors to the right, up, and back from what the camera looks at."""
    back = unit(moved(camera.eye, -1.0, camera.at))
    right = unit(cross(camera.up, back))
    return right, cross(back, right), back


def moved(start: Vector, by: float, way: Vector) -> Vector:
    """Return ``start + by * way``."""
    return start[0] + by * way[0], start[1] + by * way[1], start[2] + by * way[2]


def length(v: Vector) -> float:
    """Return the length of a vector."""
    return math.sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2])


def unit(v: Vector) -> Vector:
    """Return the vector at length one; zero stays zero. Scales first, so that no square is lost."""
    size = max(abs(part) for part in v) or 1.0
    scaled = v[0] / size, v[1] / size, v[2] / size
    return moved((0.0, 0.0, 0.0), 1.0 / (length(scaled) or 1.0), scaled)
