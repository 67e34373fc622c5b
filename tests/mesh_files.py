"""Meshes of arrays, and what a join makes of them."""

from __future__ import annotations

import numpy as np

from bfrt.formats.mesh import (
    Faces,
)


class Arrays:
    """A mesh of arrays, in blocks of any size; what it is may change from pass to pass."""

    name = "mesh"
    what = "vertex"
    painted = has_normals = False
    normals = None

    def __init__(self, vertices, faces, *, block=3):
        self.arrays = np.asarray(vertices)
        self.lists = faces
        self.block = block
        self.vertices, self.columns = self.arrays.shape
        self.row = self.coordinates = self.arrays.dtype
        self.passes = 0

    def vertex_blocks(self):
        for first in range(0, len(self.arrays), self.block):
            yield self.arrays[first : first + self.block].copy()

    def face_blocks(self):
        self.passes += 1
        for first in range(0, len(self.lists), self.block):
            part = self.lists[first : first + self.block]
            indices = np.array([i for face in part for i in face], np.int64)
            yield Faces(indices, np.array([len(face) for face in part], np.uint32))

    def numbers(self):
        return iter(())


def together(blocks):
    """All corners and counts of a join."""
    corners, counts = [np.empty((0, 0))], []
    for block, faces in blocks:
        assert len(block) == faces.counts.sum()
        corners.append(block.copy())
        counts += faces.counts.tolist()
    corners = [block for block in corners if block.size]
    return (np.concatenate(corners) if corners else np.empty(0)), counts


def random_mesh(rng, n, faces, columns=3, dtype=np.float32, sizes=(3, 9)):
    lists = [rng.integers(0, n, rng.integers(*sizes)).tolist() for _ in range(faces)]
    return rng.normal(size=(n, columns)).astype(dtype), lists
