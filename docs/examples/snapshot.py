"""A snapshot as openPMD has it: a plasma's wake, its last iteration, painted by momentum.

python snapshot.py [FOLDER [PIXELS]]
"""

from __future__ import annotations

import sys
from pathlib import Path

import h5py
import numpy as np

import bfrt

COUNT = 150_000
CELL = 1e-7  # meters
ITERATIONS = (0, 500, 1000)


def wake(iteration: int) -> tuple[np.ndarray, np.ndarray]:
    """Positions (n, 3), in cells, and momenta (n,) of electrons that a pulse has pushed aside."""
    random = np.random.default_rng(iteration)
    behind = 3.2 * random.random(COUNT)
    bubble = np.abs(np.sin(np.pi * behind)) ** 0.5 * 40 / (1 + 0.25 * behind)
    r = (bubble + 1.5) * (1 + random.normal(0, 0.035, COUNT))
    turn = 2 * np.pi * random.random(COUNT)
    along = iteration - 75 * behind + random.normal(0, 0.6, COUNT)
    return np.stack([r * np.cos(turn), r * np.sin(turn), along], -1), np.cos(2 * np.pi * behind)


def write_openpmd(path: Path) -> None:
    """Each particle has the cell that it is in, and its place there, in units of meters."""
    with h5py.File(path, "w") as file:
        file.attrs.update({"openPMD": "1.1.0", "basePath": "/data/%T/", "particlesPath": "p/"})
        for iteration in ITERATIONS:
            electrons = file.create_group(f"data/{iteration}/p/electrons")
            places, momenta = wake(iteration)
            for k, axis in enumerate("xyz"):
                cells = np.floor(places[:, k]).astype(np.int32)
                electrons[f"positionOffset/{axis}"] = cells
                electrons[f"position/{axis}"] = (places[:, k] - cells).astype(np.float32)
                for record in ("position", "positionOffset"):
                    electrons[f"{record}/{axis}"].attrs["unitSI"] = CELL
            electrons["momentum/z"] = momenta
            electrons["momentum/z"].attrs["unitSI"] = 1.0


def main(folder: Path, pixels: int = 512) -> None:
    write_openpmd(folder / "wake.h5")
    wanted = {"radius": 0.4 * CELL, "color_by": "momentum/z", "memory": "256MiB"}
    scene = bfrt.convert(folder / "wake.h5", folder / "wake.bfrt", frame=-1, **wanted)
    eye, at = (130 * CELL, 90 * CELL, 1010 * CELL), (0, -12 * CELL, 912 * CELL)
    camera = bfrt.Camera(eye, at, (0, 1, 0), angle=58, resolution=(pixels, pixels))
    scene.render(camera=camera, memory="256MiB").save(folder / "snapshot.png")


if __name__ == "__main__":
    main(Path(*sys.argv[1:2]), *map(int, sys.argv[2:3]))
