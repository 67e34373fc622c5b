"""A turn around a scene: all its views share the passes over it.

python turntable.py [FOLDER [PIXELS]]
"""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path

import bfrt

COLUMNS = 4


def main(folder: Path, pixels: int = 512) -> None:
    scene = bfrt.spd.teapot(12).write(folder / "teapot.bfrt")
    side = pixels // COLUMNS
    start = replace(scene.camera, resolution=(side, side))
    views = scene.turntable(COLUMNS * COLUMNS, start)
    images = scene.render(camera=views, memory="256MiB")
    images.save_sheet(folder / "turntable.png", COLUMNS)
    images.save_animation(folder / "turn.png")  # or .gif, with bfrt[animation]


if __name__ == "__main__":
    main(Path(*sys.argv[1:2]), *map(int, sys.argv[2:3]))
