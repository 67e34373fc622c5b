"""A room as a laser scanner sees it: two scans in an E57 file, each from where it stood.

python scan.py [FOLDER [PIXELS]]
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pye57

import bfrt

ROWS, COLUMNS = 180, 360
STANDS = ((-1.2, -0.9, 1.5), (1.4, 1.1, 1.4))
LOW, HIGH = (np.array(color) for color in ((0.35, 0.7, 0.9), (0.9, 0.4, 0.15)))


def box(low: tuple[float, ...], high: tuple[float, ...]) -> np.ndarray:
    """The twelve triangles of a box, (12, 3, 3)."""
    corner = np.array([[(low, high)[k >> axis & 1][axis] for axis in range(3)] for k in range(8)])
    sides = [(0, 1, 3, 2), (4, 5, 7, 6), (0, 1, 5, 4), (2, 3, 7, 6), (0, 2, 6, 4), (1, 3, 7, 5)]
    return corner[[corners for a, b, c, d in sides for corners in ((a, b, c), (a, c, d))]]


def scanned(room: bfrt.Scene, stand: np.ndarray) -> dict[str, np.ndarray]:
    """What a scanner sees that turns, in its own frame; colors tell what is low and what high."""
    turns = np.linspace(-np.pi, np.pi, COLUMNS, endpoint=False), np.linspace(-1.5, 1.5, ROWS)
    azimuth, elevation = (angles.ravel() for angles in np.meshgrid(*turns))
    flat = np.cos(elevation)
    ways = np.stack([flat * np.cos(azimuth), flat * np.sin(azimuth), np.sin(elevation)], -1)
    points = ways * room.cast_rays(np.broadcast_to(stand, ways.shape), ways)["t_hit"][:, None]
    height = np.clip((points[:, 2:] + stand[2]) / 2.6, 0, 1)
    colors = (255 * (LOW + (HIGH - LOW) * height)).astype(np.uint8)
    scan = {f"cartesian{axis}": points[:, k].astype("f4") for k, axis in enumerate("XYZ")}
    return scan | {f"color{name}": colors[:, k] for k, name in enumerate(("Red", "Green", "Blue"))}


def main(folder: Path, pixels: int = 512) -> None:
    with bfrt.SceneWriter(folder / "room.bfrt") as writer:
        for low, high in (((-2.5, -2, 0), (2.5, 2, 2.6)), ((-0.8, -0.5, 0.7), (0.8, 0.5, 0.8))):
            writer.triangles(box(low, high))
        writer.cones([(0, 0, 0)], [0.3], [(0, 0, 0.7)], [0.1])
        writer.spheres([(0.3, 0.1, 1.05), (1.5, -0.9, 0.5)], [0.25, 0.5])
    file = pye57.E57(str(folder / "room.e57"), "w")
    for stand in map(np.array, STANDS):
        scan = scanned(bfrt.open(folder / "room.bfrt"), stand)
        file.write_scan_raw(scan, rotation=np.array([1, 0, 0, 0]), translation=stand)
    file.close()
    made = {"radius": "auto", "color_by": "rgb", "memory": "256MiB"}
    scene = bfrt.convert(folder / "room.e57", folder / "scan.bfrt", **made)
    camera = bfrt.Camera((-1.9, -1.6, 2.1), (0.4, 0.3, 0.6), angle=75, resolution=(pixels, pixels))
    scene.render(camera=camera, memory="256MiB", samples=4).save(folder / "scan.png")


if __name__ == "__main__":
    main(Path(*sys.argv[1:2]), *map(int, sys.argv[2:3]))
