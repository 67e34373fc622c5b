"""What a watchtower sees of a terrain: a ray to every triangle.

python sight.py [FOLDER [PIXELS]]
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np

import bfrt

SIDE = 257  # heights an axis; a terrain of any size is written band by band
TOWER = np.array([0.2, -0.15])


def heights(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Ridges of six sizes, each about half as high as the one before."""
    turns = [(2 ** (k * 0.9), 1.9 * k) for k in range(6)]
    return sum(
        0.16 / f * (1 - abs(np.sin(2 * f * (x * np.cos(a) + y * np.sin(a)) + a))) for f, a in turns
    )


def terrain() -> np.ndarray:
    """Triangles (n, 3, 3), two to a square of the grid."""
    x, y = np.meshgrid(np.linspace(-1, 1, SIDE), np.linspace(-1, 1, SIDE))
    p = np.stack([x, y, heights(x, y)], axis=2)
    a, b, c, d = p[:-1, :-1], p[:-1, 1:], p[1:, 1:], p[1:, :-1]
    return np.stack([a, b, c, a, c, d], axis=2).reshape(-1, 3, 3)


def main(folder: Path, pixels: int = 512) -> None:
    triangles = terrain()
    with bfrt.SceneWriter(folder / "terrain.bfrt") as writer:
        writer.triangles(triangles)
    scene = bfrt.open(folder / "terrain.bfrt")

    tower = np.append(TOWER, heights(*TOWER) + 0.03)
    ways = triangles.mean(axis=1) - tower  # which stop a little before the triangle itself
    hidden = scene.occluded(np.broadcast_to(tower, ways.shape), ways, t_max=0.999)["occluded"]
    print(f"the tower sees {1 - hidden.mean():.0%} of {len(ways):,} triangles")

    with bfrt.SceneWriter(folder / "sight.bfrt") as writer:
        writer.light(bfrt.Light((-3.0, 2.0, 2.5)))
        writer.background((0.55, 0.7, 0.9))
        seen, unseen = bfrt.Material((1.0, 0.75, 0.3)), bfrt.Material((0.2, 0.3, 0.4))
        colors = np.array([writer.material(seen), writer.material(unseen)])
        writer.triangles(triangles, colors[hidden.astype(int)])
        red = writer.material(bfrt.Material((1.0, 0.1, 0.1)))
        writer.cones([tower - (0, 0, 0.05)], [0.012], [tower], [0.012], red)
        writer.camera(bfrt.Camera((1.3, -1.9, 1.5), (0, 0, 0), (0, 0, 1), 50, 0, (pixels, pixels)))
    bfrt.render(folder / "sight.bfrt", memory="256MiB").save(folder / "sight.png")


if __name__ == "__main__":
    main(Path(*sys.argv[1:2]), *map(int, sys.argv[2:3]))
