"""What a watchtower sees of a terrain that is a GeoTIFF: sight.py [FOLDER [PIXELS]]."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import rasterio

import bfrt

SIDE, PIXEL = 512, 20.0  # heights an axis, and meters from one to the next
TOWER, TALL = (505_710.0, 5_394_390.0), 25.0  # in the raster's own coordinates


def write_terrain(path: Path) -> np.ndarray:
    """Mountains of a fractal: waves of all lengths, of heights as their lengths."""
    along, down = np.fft.rfftfreq(SIDE), np.fft.fftfreq(SIDE)
    length = 1 / np.maximum(np.hypot(down[:, None], along), 1 / SIDE)
    waves = length**2.0 * np.exp(2j * np.pi * np.random.default_rng(12).random(length.shape))
    heights = np.fft.irfft2(waves, (SIDE, SIDE))
    heights = 1800 * ((heights - heights.min()) / np.ptp(heights)) ** 1.3
    place = {"crs": "EPSG:32632", "transform": rasterio.Affine(PIXEL, 0, 5e5, 0, -PIXEL, 54e5)}
    size = {"width": SIDE, "height": SIDE, "count": 1, "dtype": "float32"}
    with rasterio.open(path, "w", driver="GTiff", **size, **place) as file:
        file.write(heights.astype("float32"), 1)
    return heights


def colored(path: Path, heights: np.ndarray, seen: np.ndarray) -> bfrt.Scene:
    """The terrain, of which what is seen is light, around the tower; and the tower."""
    x, y = np.meshgrid(*[np.arange(SIDE) + 0.5] * 2)
    p = np.stack([5e5 + PIXEL * x, 54e5 - PIXEL * y, heights], axis=2) - (*TOWER, 0)
    a, b, c, d = p[:-1, :-1], p[:-1, 1:], p[1:, 1:], p[1:, :-1]
    foot = (0.0, 0.0, heights[int((54e5 - TOWER[1]) / PIXEL), int((TOWER[0] - 5e5) / PIXEL)])
    tones = [(0.2, 0.26, 0.33), (1.0, 0.78, 0.4), (1.0, 0.1, 0.1)]
    with bfrt.SceneWriter(path) as writer:
        dark, light, red = (writer.material(bfrt.Material(tone)) for tone in tones)
        shades = np.repeat(np.where(seen[:-1, :-1], light, dark).ravel(), 2)
        writer.triangles(np.stack([a, c, b, a, d, c], axis=2).reshape(-1, 3, 3), shades)
        writer.cones([foot], [60.0], [np.add(foot, (0, 0, 300))], [60.0], red)
        writer.light(bfrt.Light((-20_000.0, 9_000.0, 9_000.0)))
        writer.background((0.55, 0.7, 0.9))
    return bfrt.open(path)


def main(folder: Path, pixels: int = 512) -> None:
    heights = write_terrain(folder / "dem.tif")
    bfrt.viewshed(folder / "dem.tif", folder / "seen.tif", TOWER, height=TALL, curvature=True)
    with rasterio.open(folder / "seen.tif") as file:
        scene = colored(folder / "sight.bfrt", heights, file.read(1) == 255)
    camera = bfrt.Camera((600, -9500, 7600), (200, 200, 300), (0, 0, 1), 44, 0, (pixels, pixels))
    scene.render(camera=camera, memory="256MiB").save(folder / "sight.png")


if __name__ == "__main__":
    main(Path(*sys.argv[1:2]), *map(int, sys.argv[2:3]))
