"""A coarse mesh twice: as flat triangles, and shaded by the normals of its vertices.

python smooth.py [FOLDER [PIXELS]]
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np

import bfrt

ALONG, AROUND = 22, 12
WIDE, THICK = 1.0, 0.42
TURNED = np.array([[1, 0, 0], [0, 0.6, -0.8], [0, 0.8, 0.6]])


def torus() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Vertices (n, 3), triangles (m, 3), and normals (n, 3)."""
    a, b = np.mgrid[:ALONG, :AROUND].reshape(2, -1) * 2 * np.pi / [[ALONG], [AROUND]]
    out = np.stack([np.cos(a), np.sin(a), np.zeros_like(a)], axis=-1)
    normals = np.cos(b)[:, None] * out + np.sin(b)[:, None] * [0, 0, 1]
    number = np.arange(ALONG * AROUND).reshape(ALONG, AROUND)
    ahead, aside = np.roll(number, -1, axis=0), np.roll(number, -1, axis=1)
    across = np.roll(ahead, -1, axis=1)
    faces = np.stack([number, ahead, across, number, across, aside], axis=-1).reshape(-1, 3)
    return (WIDE * out + THICK * normals) @ TURNED.T, faces, normals @ TURNED.T


def main(folder: Path, pixels: int = 512) -> None:
    vertices, faces, normals = torus()
    with bfrt.SceneWriter(folder / "smooth.bfrt") as writer:
        own = writer.material(bfrt.Material((0.9, 0.55, 0.25)))
        writer.mesh(np.add(vertices, [-1.5, 1.0, 0]), faces, materials=own)
        writer.mesh(np.add(vertices, [1.5, -1.0, 0]), faces, normals, materials=own)
        writer.light(bfrt.Light((-8, 1, 9)))
        writer.background((0.02, 0.03, 0.05))
        scene = writer.close()
    camera = bfrt.Camera((0, 0, 9), (0, 0, 0), (0, 1, 0), angle=40, resolution=(pixels, pixels))
    scene.render(camera=camera, memory="256MiB").save(folder / "smooth.png")


if __name__ == "__main__":
    main(Path(*sys.argv[1:2]), *map(int, sys.argv[2:3]))
