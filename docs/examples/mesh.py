"""A mesh from a file: a knot as binary PLY, painted by a number at each vertex.

python mesh.py [FOLDER [PIXELS]]
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np

import bfrt

ALONG, AROUND = 1536, 96  # vertices; twice as many faces


def knot() -> tuple[np.ndarray, np.ndarray]:
    """Vertices (n, 4), x y z and how far from the axis, and faces (m, 3)."""
    turn = 2 * np.pi / np.array([ALONG, AROUND])
    t, s = np.moveaxis(np.mgrid[:ALONG, :AROUND].T * turn, -1, 0).swapaxes(1, 2)
    r = 2 + np.cos(3 * t)
    middle = np.stack([r * np.cos(2 * t), r * np.sin(2 * t), np.sin(3 * t)], axis=-1)
    ahead = np.roll(middle, -1, axis=0) - middle
    side = np.cross(ahead, [0.0, 0.0, 1.0])
    side /= np.linalg.norm(side, axis=-1, keepdims=True)
    over = np.cross(side, ahead)
    over /= np.linalg.norm(over, axis=-1, keepdims=True)
    tube = 0.38 + 0.05 * np.sin(8 * s + 60 * t)
    p = middle + tube[..., None] * (np.cos(s)[..., None] * side + np.sin(s)[..., None] * over)
    vertices = np.concatenate([p, np.linalg.norm(p[..., :2], axis=-1)[..., None]], axis=-1)
    number = np.arange(ALONG * AROUND).reshape(ALONG, AROUND)
    a, b = number, np.roll(number, -1, axis=0)
    c, d = np.roll(b, -1, axis=1), np.roll(a, -1, axis=1)
    return vertices.reshape(-1, 4), np.stack([a, b, c, a, c, d], axis=-1).reshape(-1, 3)


def write_ply(path: Path) -> None:
    """What a scanner or a modeler writes."""
    vertices, faces = knot()
    rows = np.empty(len(faces), [("corners", "u1"), ("vertices", "<i4", 3)])
    rows["corners"], rows["vertices"] = 3, faces
    header = ["ply", "format binary_little_endian 1.0", f"element vertex {len(vertices)}"]
    header += [f"property float {name}" for name in ("x", "y", "z", "distance")]
    header += [f"element face {len(faces)}", "property list uchar int vertex_indices"]
    parts = "\n".join([*header, "end_header\n"]).encode(), vertices.astype("<f4"), rows
    path.write_bytes(b"".join(parts))


def main(folder: Path, pixels: int = 512) -> None:
    write_ply(folder / "knot.ply")
    ply, store = folder / "knot.ply", folder / "knot.bfrt"
    scene = bfrt.convert(ply, store, color_by="distance", memory="256MiB")
    camera = bfrt.framing_camera(scene, resolution=(pixels, pixels), angle=30)
    scene.render(camera=camera, memory="256MiB").save(folder / "mesh.png")


if __name__ == "__main__":
    main(Path(*sys.argv[1:2]), *map(int, sys.argv[2:3]))
