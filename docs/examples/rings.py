"""SPD's rings: a pyramid of linked rings before a wall.

python rings.py [FOLDER [PIXELS]]
"""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path

import bfrt


def main(folder: Path, pixels: int = 512) -> None:
    scene = bfrt.spd.rings(7).write(folder / "rings.bfrt")
    camera = replace(scene.camera, resolution=(pixels, pixels))
    image = scene.render(camera=camera, memory="256MiB")
    image.save(folder / "rings.png")


if __name__ == "__main__":
    main(Path(*sys.argv[1:2]), *map(int, sys.argv[2:3]))
