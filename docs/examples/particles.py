"""A snapshot of particles: a galaxy as HDF5, painted by temperature.

python particles.py [FOLDER [PIXELS]]
"""

from __future__ import annotations

import sys
from pathlib import Path

import h5py
import numpy as np

import bfrt

COUNT = 200_000
ARMS = 2


def write_snapshot(path: Path) -> None:
    """Datasets as simulations name them; of a real snapshot a block is written at a time."""
    random = np.random.default_rng(4)
    far = random.gamma(2.0, 2.2, COUNT)
    bulge = random.random(COUNT) < 0.12
    turn = 2 * np.pi * random.integers(0, ARMS, COUNT) / ARMS + 2.4 * np.log1p(far)
    turn += random.normal(0, 0.22, COUNT)
    disk = np.stack([far * np.cos(turn), far * np.sin(turn), random.normal(0, 0.2, COUNT)], -1)
    ball = random.normal(0, 0.9, (COUNT, 3)) * (1, 1, 0.7)
    positions = np.where(bulge[:, None], ball, disk)
    with h5py.File(path, "w") as file:
        gas = file.create_group("PartType0")
        gas["Coordinates"] = positions.astype(np.float32)
        gas["Temperature"] = 6 - 0.15 * np.linalg.norm(positions, axis=1)
        gas["SmoothingLength"] = random.uniform(0.02, 0.07, COUNT).astype(np.float32)


def main(folder: Path, pixels: int = 512) -> None:
    write_snapshot(folder / "galaxy.h5")
    scene = bfrt.convert(
        folder / "galaxy.h5",
        folder / "galaxy.bfrt",
        radius="SmoothingLength",
        color_by="Temperature",
        color_range=(4.4, 6.0),
        memory="256MiB",
    )
    camera = bfrt.Camera((6, -25, 21), (0, 0, 0), angle=50, resolution=(pixels, pixels))
    scene.render(camera=camera, memory="256MiB").save(folder / "particles.png")


if __name__ == "__main__":
    main(Path(*sys.argv[1:2]), *map(int, sys.argv[2:3]))
