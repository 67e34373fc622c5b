"""Light at surfaces by the textbook, in float64: what rendered values are held to.

A picture is the mean of the rays at each pixel's four corners, so that a test works out the value
of every corner, (height + 1, width + 1, ...), from the geometry that it has made, and averages.
Vectors are the last axis; where a ray meets nothing, a place is NaN.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

import bfrt

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

#: What a scene is made of: the writer's method, what it takes, and the material.
Thing = tuple[Any, ...]

#: Each light's intensity, and that of the ambient one, by how many lights there are.
INTENSITY = {1: 0.5, 2: math.sqrt(2) / 4, 3: math.sqrt(3) / 6, 4: 0.25}


#: Light of all kinds, for a scene of a few units about the origin.
LIT: dict[str, Any] = {
    "lights": (bfrt.Sun(140, 35, (1.0, 0.8, 0.6)), bfrt.Light((5.0, -8.0, 9.0)), bfrt.Sun(300, 5)),
    "ambient": 0.8,
    "ao": 5,
    "ao_distance": 1.5,
    "background": (0.1, 0.25, 0.5),
}

# --- scenes and pictures -----------------------------------------------------------------------


def written(
    path: Path,
    things: Sequence[Thing],
    lights: Sequence[bfrt.Light],
    background: tuple[float, float, float] = (0.0, 0.0, 0.0),
    **settings: Any,
) -> bfrt.Scene:
    """The scene of these things and lights, as a store at `path`."""
    with bfrt.SceneWriter(path, durable=False, **settings) as writer:
        for light in lights:
            writer.light(light)
        writer.background(background)
        for method, *shape, material in things:
            getattr(writer, method)(*shape, writer.material(material))
    return bfrt.open(path)


def rendered(scene: bfrt.Scene, camera: bfrt.Camera, **settings: Any) -> bfrt.Image:
    """Its picture; small ones take one thread."""
    return scene.render(**{"camera": camera, "memory": "128MiB", "threads": 1, **settings})


def ball(radius: float, material: bfrt.Material, center: ArrayLike = (0, 0, 0)) -> Thing:
    return "spheres", [center], [radius], material


def floor(z: float, half: float, material: bfrt.Material) -> Thing:
    """A square about the z axis that faces up, as a polygon."""
    return "polygons", np.array(square(z, half)), [4], material


def square(z: float, half: float) -> list[list[float]]:
    """Its corners, counterclockwise from above."""
    return [[-half, -half, z], [half, -half, z], [half, half, z], [-half, half, z]]


# --- rays --------------------------------------------------------------------------------------


def film_points(camera: bfrt.Camera, columns: ArrayLike, rows: ArrayLike) -> Array:
    """Unit directions through places of the image, in pixels from its upper left corner.

    The angle is from the bottom edge to the top; pixels are square.
    """
    width, height = camera.resolution
    forward = unit(np.subtract(camera.at, camera.eye))
    right = unit(np.cross(forward, camera.up))
    up = np.cross(right, forward)
    pixel = 2 * math.tan(math.radians(camera.angle) / 2) / height
    x = (np.asarray(columns, float) - width / 2)[..., None] * pixel
    y = (height / 2 - np.asarray(rows, float))[..., None] * pixel
    return unit(forward + x * right + y * up)


def corner_rays(camera: bfrt.Camera) -> Array:
    """Unit directions of the corners of all pixels."""
    width, height = camera.resolution
    columns, rows = np.meshgrid(np.arange(width + 1), np.arange(height + 1))
    return film_points(camera, columns, rows)


def film(corners: ArrayLike) -> Array:
    """The pixels' values: each the mean of its corners'."""
    c = np.asarray(corners, float)
    return (c[:-1, :-1] + c[:-1, 1:] + c[1:, :-1] + c[1:, 1:]) / 4


def meet_ball(
    eye: ArrayLike, d: Array, radius: float = 1.0, center: ArrayLike = (0, 0, 0)
) -> Array:
    """Where rays of unit directions from outside enter a ball."""
    to = np.subtract(center, eye)
    along = dot(to, d)
    miss = along[..., None] * d - to
    with np.errstate(invalid="ignore"):
        half_chord = np.sqrt(radius**2 - dot(miss, miss))
    near = np.where(along > half_chord, along - half_chord, np.nan)
    return eye + near[..., None] * d


def meet_level(eye: ArrayLike, d: Array, z: float, half: float = math.inf) -> Array:
    """Where rays meet the square of that half side, at height z about the z axis."""
    eye = np.asarray(eye, float)
    with np.errstate(divide="ignore", invalid="ignore"):
        t = (z - eye[..., 2]) / d[..., 2]
        place = eye + np.where(t > 0, t, np.nan)[..., None] * d
        place[..., 2] = z
        inside = (t > 0) & (np.abs(place[..., :2]) <= half).all(axis=-1)
    return np.where(inside[..., None], place, np.nan)


def met(place: Array) -> Mask:
    """Which rays have met something."""
    return ~np.isnan(place).any(axis=-1)


# --- light -------------------------------------------------------------------------------------


def dot(a: ArrayLike, b: ArrayLike) -> Array:
    return np.sum(np.multiply(a, b), axis=-1)


def unit(v: ArrayLike) -> Array:
    return np.asarray(v, float) / np.linalg.norm(v, axis=-1, keepdims=True)


def mirrored(v: ArrayLike, n: ArrayLike) -> Array:
    """v with its part along the unit normal n turned round: a ray after a mirror."""
    return np.asarray(v) - 2 * dot(v, n)[..., None] * n


def shade(
    eye: ArrayLike,
    place: Array,
    normal: ArrayLike,
    material: bfrt.Material,
    lights: Sequence[bfrt.Light | bfrt.Sun],
    clear: ArrayLike = True,
) -> Array:
    """What is seen from `eye` of a surface under these lights: ambient, Lambert and Phong.

    The unit normal is on the eye's side; `clear` is where nothing is between place and light.
    """
    color = np.array(material.color)
    light = np.full((*place.shape[:-1], 3), material.kd * color)
    to_eye = unit(np.subtract(eye, place))
    for lamp in lights:
        if isinstance(lamp, bfrt.Sun):
            to = np.broadcast_to(toward(lamp), place.shape)
            tint = np.multiply(lamp.intensity, lamp.color)
        else:
            to, tint = unit(np.subtract(lamp.position, place)), np.array(lamp.color)
        cosine = dot(normal, to)
        highlight = np.maximum(dot(mirrored(-to, normal), to_eye), 0) ** material.shine
        each = material.kd * cosine[..., None] * color + material.ks * highlight[..., None]
        light += np.where((clear & (cosine > 0))[..., None], each * tint, 0)
    return INTENSITY[len(lights)] * np.where(met(place)[..., None], light, 0)


def toward(sun: bfrt.Sun) -> Array:
    """The unit vector to a sun: a compass, with north at +y, that is tilted up."""
    azimuth, elevation = np.radians([sun.azimuth, sun.elevation])
    level = np.array([np.sin(azimuth), np.cos(azimuth), 0.0])
    return np.cos(elevation) * level + np.sin(elevation) * np.array([0.0, 0.0, 1.0])


def over(front: Array, hit: Mask, behind: ArrayLike) -> Array:
    """Values of a surface where it is hit, and elsewhere of what is behind."""
    return np.where(hit[..., None], front, behind)
