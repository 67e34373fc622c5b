"""SPD's tetra: a Sierpinski tetrahedron, four smaller ones at the corners of each.

A tetrahedron takes four corners of a cube, those whose signs multiply to 1; so do the four that it
is made of. Size n is 4^(n - 1) tetrahedra of four triangles.
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import lru_cache, partial

import numpy as np
import numpy.typing as npt

from bfrt.records import Kind
from bfrt.spd.blocks import BLOCK_OBJECTS, Block, Part, Scalar, Task
from bfrt.spd.recipe import SpdScene, phong_power
from bfrt.store.model import Camera, Light, Material

CORNERS = np.array([(-1.0, -1.0, 1.0), (-1.0, 1.0, -1.0), (1.0, -1.0, -1.0), (1.0, 1.0, 1.0)])
FACES = np.array([(0, 1, 2), (3, 2, 1), (2, 3, 0), (1, 0, 3)])


class Tetra(SpdScene):
    """Makes the tetrahedron of `size` levels."""

    name = "tetra"
    camera = Camera(
        eye=(1.022846, -3.177154, -2.174512),
        at=(-0.004103, -0.004103, 0.216539),
        up=(-0.816497, -0.816497, 0.816497),
        angle=45.0,
    )
    lights = (Light((2.0, -18.0, -5.0)),)
    background = (0.078, 0.361, 0.753)
    materials = (Material((1.0, 0.2, 0.2), kd=1.0, ks=0.0, shine=phong_power(0.0), ior=0.0),)

    @property
    def counts(self) -> dict[Kind, int]:
        return {Kind.TRIANGLE: len(CORNERS) ** self.size}

    def tasks(self, limit: int = BLOCK_OBJECTS) -> Iterator[Task]:
        """Yield parts of up to `limit` triangles; a tetrahedron of four is never cut."""
        levels = 0
        while levels + 1 < self.size and len(CORNERS) ** (levels + 2) <= limit:
            levels += 1
        half = 0.5 ** (self.size - 1 - levels)
        for center in _centers(self.size - 1 - levels):
            yield partial(_part, center, levels, half)


@lru_cache(maxsize=4)
def _centers(levels: int) -> npt.NDArray[np.float64]:
    """Return the centers of a level's tetrahedra, (4^levels, 3), in half sides of the first."""
    centers = np.zeros((1, 3))
    for level in range(levels):
        centers = (centers[:, None] + CORNERS * 0.5 ** (level + 1)).reshape(-1, 3)
    return centers


@lru_cache(maxsize=4)
def _triangles(levels: int) -> npt.NDArray[np.float64]:
    """Return all triangles of a tetrahedron of some levels about its center, in units of its half
    side: (4^levels, 36), four triangles a row.
    """
    corners = CORNERS * 0.5**levels
    return (_centers(levels)[:, None] + corners)[:, FACES].reshape(-1, 36)


def _part(center: npt.NDArray[np.float64], levels: int, half: float, dtype: Scalar) -> Block:
    """Make the triangles of one tetrahedron of `levels` more levels.

    All is sums of powers of two, and exact in whatever order they are added.
    """
    triangles = _triangles(levels)
    records = np.empty(triangles.shape, dtype)
    np.multiply(triangles, half, out=records, casting="same_kind")
    records += np.tile(center, 12).astype(dtype)
    n = 4 * len(records)
    return (Part(Kind.TRIANGLE, records.reshape(n, 9), np.zeros(n, np.uint32), np.arange(n)),)
