"""The seven standard scenes at their default sizes.

python gallery.py [FOLDER [PIXELS]]
"""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path

import bfrt


def main(folder: Path, pixels: int = 320) -> None:
    for name, size in bfrt.spd.DEFAULT_SIZES.items():
        scene = bfrt.spd.scene(name, size).write(folder / f"spd-{name}.bfrt")
        camera = replace(scene.camera, resolution=(pixels, pixels))
        scene.render(camera=camera, memory="256MiB").save(folder / f"spd-{name}.png")


if __name__ == "__main__":
    main(Path(*sys.argv[1:2]), *map(int, sys.argv[2:3]))
