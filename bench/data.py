"""Data such as people have, of any size: particles as HDF5, a terrain as PLY; made block by block.

::

    python bench/data.py particles 100000000 snapshot.h5    clusters, as a cosmologist's snapshot
    python bench/data.py terrain   5001      terrain.ply    heights an axis: 50 million triangles
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np

BLOCK = 1 << 20

#: Particles of a cluster, on average, and the box's side.
CLUSTER = 1000
BOX = 100.0


def particles(count: int, path: Path) -> None:
    """Clusters with dense middles, one after the other, along lines between a few nodes."""
    import h5py

    random = np.random.default_rng(1)
    spacing = BOX / count ** (1 / 3)
    with h5py.File(path, "w") as file:
        group = file.create_group("PartType0")
        positions = group.create_dataset("Coordinates", (count, 3), "f4")
        densities = group.create_dataset("Density", (count,), "f4")
        radii = group.create_dataset("SmoothingLength", (count,), "f4")
        nodes = random.uniform(0, BOX, (60, 3))
        apart = np.linalg.norm(nodes[:, None] - nodes, axis=2)
        near = np.argsort(apart, axis=1)[:, 1:4]  # lines go to the three nearest
        for first in range(0, count, BLOCK):
            n = min(BLOCK, count - first)
            clusters = -(-n // CLUSTER)
            a = random.integers(0, len(nodes), clusters)
            b = near[a, random.integers(0, 3, clusters)]
            along = random.beta(0.5, 0.5, (clusters, 1))
            center = nodes[a] + (nodes[b] - nodes[a]) * along
            center += random.normal(0, BOX / 150, (clusters, 3))
            size = (random.pareto(2.0, clusters) + 0.2) * BOX / 160
            of = np.sort(random.integers(0, clusters, n))
            way = random.normal(size=(n, 3))
            far = random.uniform(0.05, 1.0, n) ** 2
            way *= (size[of] * far / np.linalg.norm(way, axis=1))[:, None]
            part = slice(first, first + n)
            positions[part] = np.mod(center[of] + way, BOX)
            densities[part] = -np.log10(far * size[of])
            radii[part] = spacing * (0.06 + 0.2 * far)


def terrain(side: int, path: Path) -> None:
    """Ridges of fourteen sizes, one meter between heights, two triangles to a square."""
    with path.open("wb") as file:
        faces = 2 * (side - 1) ** 2
        file.write(
            b"ply\nformat binary_little_endian 1.0\n"
            b"element vertex %d\nproperty float x\nproperty float y\nproperty float z\n"
            b"element face %d\nproperty list uchar int vertex_indices\nend_header\n"
            % (side * side, faces)
        )
        rows = max(1, BLOCK // side)
        x = np.arange(side, dtype=np.float32)
        for first in range(0, side, rows):
            y = np.arange(first, min(first + rows, side), dtype=np.float32)[:, None]
            z = heights(x[None, :] / side, y / side) * np.float32(side)
            block = np.stack(np.broadcast_arrays(x[None, :], y, z.astype(np.float32)), axis=-1)
            file.write(block.astype("<f4").tobytes())
        record = np.dtype([("corners", "u1"), ("vertices", "<i4", 3)])
        for first in range(0, side - 1, rows):
            y = np.arange(first, min(first + rows, side - 1))[:, None]
            a = (y * side + np.arange(side - 1)).astype(np.int32)
            b, c, d = a + 1, a + side + 1, a + side
            out = np.empty(2 * a.size, record)
            out["corners"] = 3
            out["vertices"] = np.stack([a, b, c, a, c, d], axis=-1).reshape(-1, 3)
            file.write(out.tobytes())


def heights(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Ridges, each about half as high as the one before."""
    total = np.zeros(np.broadcast_shapes(x.shape, y.shape), np.float32)
    for k in range(14):
        f, a = 2 ** (k * 0.9), 1.9 * k
        u = np.float32(4 * f) * (x * np.float32(np.cos(a)) + y * np.float32(np.sin(a)))
        total += np.float32(0.08 / f) * (1 - np.abs(np.sin(u + np.float32(a))))
    return total


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("what", choices=("particles", "terrain"))
    parser.add_argument("size", type=int, help="particles, or heights an axis")
    parser.add_argument("path", type=Path)
    arguments = parser.parse_args()
    make = particles if arguments.what == "particles" else terrain
    make(arguments.size, arguments.path)


if __name__ == "__main__":
    main()
