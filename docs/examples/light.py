"""A town in the afternoon: a sun, and the light of the sky where it comes to.

python light.py [FOLDER [PIXELS]]
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np

import bfrt

LOTS, LOT, HOUSE = 24, 20.0, 14.0  # an axis; meters from house to house, and of a house at most
BRICK, PLASTER, ROOF, GROUND = (0.65, 0.32, 0.22), (0.9, 0.84, 0.7), (0.35, 0.2, 0.17), (0.5,) * 3

#: Corners of a house of one unit a side, by number: eight, and the two ends of its ridge.
CORNERS = [(x, y, z) for z in (0, 1) for y in (0, 1) for x in (0, 1)] + [(0.5, 0, 1), (0.5, 1, 1)]
WALLS = [(0, 1, 5, 4), (1, 3, 7, 5), (3, 2, 6, 7), (2, 0, 4, 6)]
SLOPES, GABLES = [(4, 6, 9, 8), (5, 7, 9, 8)], [(4, 5, 8), (6, 7, 9)]


def houses(rng: np.random.Generator) -> np.ndarray:
    """The corners of all houses, (LOTS^2, 10, 3)."""
    lots = np.stack(np.meshgrid(*[np.arange(LOTS) - LOTS / 2] * 2), axis=2).reshape(-1, 1, 2)
    size = rng.uniform(0.5, 1, (LOTS**2, 1, 2)) * HOUSE
    high = rng.choice([6.0, 9.0, 12.0, 30.0], (LOTS**2, 1, 1), p=[0.4, 0.4, 0.15, 0.05])
    corners = np.array(CORNERS) * np.concatenate([size, high], axis=2)
    corners[:, 8:, 2] += 0.35 * size[:, :, 0]
    corners[..., :2] += LOT * lots + rng.uniform(0, 5, size.shape)
    return corners


def main(folder: Path, pixels: int = 512) -> None:
    rng = np.random.default_rng(4)
    corners = houses(rng)
    with bfrt.SceneWriter(folder / "light.bfrt", dtype="float32") as writer:
        tones = [writer.material(bfrt.Material(tone)) for tone in (BRICK, PLASTER, ROOF, GROUND)]
        tone = rng.choice(tones[:2], LOTS**2, p=[0.3, 0.7])
        for faces, each in ((WALLS, tone), (SLOPES, np.full_like(tone, tones[2]))):
            quads = corners[:, faces].reshape(-1, 3)
            writer.polygons(quads, [4] * (len(quads) // 4), np.repeat(each, len(faces)))
        writer.triangles(corners[:, GABLES].reshape(-1, 3, 3), np.repeat(tone, 2))
        field = [(-5e3, -5e3, 0), (5e3, -5e3, 0), (5e3, 5e3, 0), (-5e3, 5e3, 0)]
        writer.polygons(field, [4], tones[3])
    camera = bfrt.Camera((55, -210, 105), (0, -35, 0), angle=32, resolution=(pixels, pixels))
    sun = bfrt.Sun(azimuth=250, elevation=35, color=(1.0, 0.85, 0.65), intensity=1.6)
    image = bfrt.render(
        folder / "light.bfrt", camera=camera, samples=4, lights=[sun], ambient=0.5,
        ao=8, ao_distance=60.0, background=(0.55, 0.7, 0.9),
    )  # fmt: skip
    image.save(folder / "light.png")


if __name__ == "__main__":
    main(Path(*sys.argv[1:2]), *map(int, sys.argv[2:3]))
