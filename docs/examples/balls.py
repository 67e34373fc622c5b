"""A sphereflake in the manner of SPD's balls: each sphere carries nine of a third its size.

python balls.py [FOLDER [PIXELS]]
"""

from __future__ import annotations

import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np

import bfrt

LEVELS = 4  # 1 + 9 + 81 + 729 + 6561 spheres; one more makes nine times as many
GROUND = [(12, 12, -0.5), (-12, 12, -0.5), (-12, -12, -0.5), (12, -12, -0.5)]


def nine_frames() -> np.ndarray:
    """Where the nine sit on a sphere whose pole is z: six at the equator, three above.

    Each is a rotation (3, 3), its third column the way outwards.
    """
    angle = np.radians([15, 75, 135, 195, 255, 315, 45, 165, 285])
    height = np.repeat([0.0, np.sqrt(2 / 3)], [6, 3])
    across = np.sqrt(1 - height**2)
    out = np.stack([across * np.cos(angle), across * np.sin(angle), height], axis=1)
    east = np.stack([-np.sin(angle), np.cos(angle), 0 * angle], axis=1)
    return np.stack([np.cross(east, out), east, out], axis=2)


def flake() -> Iterator[tuple[np.ndarray, float]]:
    """Centers (n, 3) and the radius of each level's spheres."""
    nine, frames, centers, radius = nine_frames(), np.eye(3)[None], np.zeros((1, 3)), 0.5
    yield centers, radius
    for _ in range(LEVELS):
        frames = (frames[:, None] @ nine).reshape(-1, 3, 3)
        centers = np.repeat(centers, 9, axis=0) + frames[:, :, 2] * radius * 4 / 3
        radius /= 3
        yield centers, radius


def main(folder: Path, pixels: int = 512) -> None:
    with bfrt.SceneWriter(folder / "balls.bfrt", dtype="float32") as writer:
        for position in [(4, 3, 2), (1, -4, 4), (-3, 1, 5)]:
            writer.light(bfrt.Light(position, color=(2.5, 2.5, 2.5)))
        writer.background((0.1, 0.3, 0.7))
        sand = writer.material(bfrt.Material((1.0, 0.58, 0.13), kd=0.55))
        mirror = writer.material(bfrt.Material((1.0, 0.8, 0.5), kd=0.08, ks=0.8, shine=40.0))
        writer.polygons(GROUND, [4], sand)
        for centers, radius in flake():
            writer.spheres(centers, radius, mirror)
    camera = bfrt.Camera(eye=(2.1, 1.3, 1.7), at=(0, 0, 0), resolution=(pixels, pixels))
    bfrt.render(folder / "balls.bfrt", camera=camera).save(folder / "balls.png")


if __name__ == "__main__":
    main(Path(*sys.argv[1:2]), *map(int, sys.argv[2:3]))
