"""A terrain, what bfrt and GDAL see of it, and where they differ; needs gdal_viewshed.

python viewshed.py [FOLDER [PIXELS]]
"""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import numpy as np
import rasterio
from sight import PIXEL, SIDE, TALL, TOWER, write_terrain

import bfrt


def shaded(heights: np.ndarray) -> np.ndarray:
    """The terrain from above, (SIDE, SIDE, 3), under a sun in the northwest."""
    down, along = np.gradient(heights, PIXEL)
    light = (1 + along + down) / np.sqrt(3 * (1 + along**2 + down**2))
    return np.clip(0.15 + 0.6 * light, 0, 1)[..., None] * (1.0, 0.97, 0.9)


def seen_by(program: str, folder: Path) -> np.ndarray:
    """What a program sees, (SIDE, SIDE) bool, as the earth is round and the air bends light."""
    dem, out = folder / "dem.tif", folder / f"{program}.tif"
    if program == "bfrt":
        bfrt.viewshed(dem, out, TOWER, height=TALL, curvature=True)
    else:
        place = ["-ox", TOWER[0], "-oy", TOWER[1], "-oz", TALL, "-cc", 1 - 1 / 7]
        subprocess.run(["gdal_viewshed", "-q", *map(str, place), dem, out], check=True)
    with rasterio.open(out) as file:
        return file.read(1) == 255


def main(folder: Path, pixels: int = 512) -> None:
    terrain = shaded(write_terrain(folder / "dem.tif"))
    ours, other = (seen_by(program, folder) for program in ("bfrt", "gdal"))
    maps = [terrain]
    for seen, tone in ((ours, (1, 0.7, 0.2)), (other, (0.3, 0.75, 1)), (ours != other, (4, 0, 0))):
        print(f"{seen.mean():.2%}")
        maps.append(np.where(seen[..., None], 0.25 + 0.75 * np.array(tone), 0.25) * terrain)
    each = 2 * SIDE // pixels  # pixels of the terrain, along a side of one of a small map
    shape = (pixels // 2, each, pixels // 2, each, 3)
    small = [whole.reshape(shape).mean(axis=(1, 3)).astype("f4") for whole in maps]
    rgb = np.round(np.vstack([np.hstack(small[:2]), np.hstack(small[2:])]) * 32) / 32
    channels = {name: rgb[..., k] for k, name in enumerate("RGB")}
    channels["A"] = np.ones(rgb.shape[:2], "f4")
    bfrt.Image(channels).save(folder / "viewshed.png")


if __name__ == "__main__":
    main(Path(*sys.argv[1:2]), *map(int, sys.argv[2:3]))
