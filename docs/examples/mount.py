"""A fractal mountain under four balls of glass, in the manner of SPD's mount.

python mount.py [FOLDER [PIXELS]]
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np

import bfrt

LEVELS = 8  # 2 x 256 x 256 = 131072 triangles
ROUGH = 0.45  # what is left of the displacement when the distance halves
BALLS = np.array([(-80, 80, 121), (-66, 66, 93), (-75, 99, 93), (-99, 75, 93)]) / 100


def heights() -> np.ndarray:
    """Midpoint displacement on a square: (2^LEVELS + 1, 2^LEVELS + 1)."""
    rng = np.random.default_rng(9)
    z = np.zeros((2, 2))
    for level in range(LEVELS):
        n = 2 * len(z) - 1
        finer = np.empty((n, n))
        finer[::2, ::2] = z
        finer[1::2, ::2] = (z[1:] + z[:-1]) / 2
        finer[:, 1::2] = (finer[:, 2::2] + finer[:, :-2:2]) / 2
        new = np.ones((n, n), bool)
        new[::2, ::2] = False
        finer[new] += rng.normal(0, 0.4 * ROUGH**level, new.sum())
        z = finer
    return z


def triangles(z: np.ndarray) -> np.ndarray:
    """Two triangles a cell of the square from -1 to 1, (n, 3, 3)."""
    side = np.linspace(-1, 1, len(z))
    x, y = np.meshgrid(side, side, indexing="ij")
    p = np.stack([x, y, z], axis=2)
    a, b, c, d = p[:-1, :-1], p[1:, :-1], p[1:, 1:], p[:-1, 1:]
    return np.stack([a, b, c, c, d, a], axis=2).reshape(-1, 3, 3)


def main(folder: Path, pixels: int = 512) -> None:
    with bfrt.SceneWriter(folder / "mount.bfrt", dtype="float32") as writer:
        writer.light(bfrt.Light((-100, -60, 80), color=(5.0, 4.7, 4.2)))
        writer.background((0.06, 0.16, 0.5))
        rock = writer.material(bfrt.Material((0.5, 0.42, 0.3), kd=0.32))
        glass = writer.material(bfrt.Material((1, 1, 1), 0.0, 0.1, 101.0, 0.9, 1.5))
        writer.triangles(triangles(heights()), rock)
        writer.spheres(BALLS, 0.17, glass)
    camera = bfrt.Camera(eye=(-1.6, 1.6, 1.7), at=(0, 0, 0), resolution=(pixels, pixels))
    bfrt.render(folder / "mount.bfrt", camera=camera).save(folder / "mount.png")


if __name__ == "__main__":
    main(Path(*sys.argv[1:2]), *map(int, sys.argv[2:3]))
