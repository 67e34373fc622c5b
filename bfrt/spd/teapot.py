"""SPD's teapot: Newell's, tessellated n x n a patch with its normals, on a chessboard of n x n.

A patch is a bicubic polynomial in s and t; each cell of its grid is two triangles. Two rows of
cells meet in a point, at the lid's knob and in the middle of the bottom: half of their triangles
have no area, and the package leaves those out.
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from bfrt.records import Kind
from bfrt.spd.blocks import BLOCK_OBJECTS, Block, Part, Scalar, Task
from bfrt.spd.newell import PATCHES, POINTS
from bfrt.spd.recipe import SpdScene, phong_power
from bfrt.store.model import Camera, Light, Material

#: Patches of which one side is a point: the lid's four about its knob, the bottom's four.
POINTED = 8
#: Half the chessboard's side.
BOARD = 4.0
#: A point so near to the axis is where such a side is; below this height it is the bottom's.
CUSP = 1e-4
MIDDLE = 1.5

#: Bezier's basis: rows are powers 3 to 0.
BEZIER = np.array([[-1.0, 3, -3, 1], [3, -6, 3, 0], [-3, 3, 0, 0], [1, 0, 0, 0]])

WHITE, GREY, COPPER = range(3)


Array = npt.NDArray[np.float64]


class Grid(NamedTuple):
    """Holds points of a patch and the normals there, both (rows, columns, 3)."""

    points: Array
    normals: Array


class Teapot(SpdScene):
    """Makes the teapot of `size` x `size` cells a patch."""

    name = "teapot"
    settled = 20
    camera = Camera(eye=(4.86, 7.2, 5.4), at=(0.0, 0.0, 0.0), angle=45.0)
    lights = (Light((-3.1, 9.8, 12.1)), Light((11.3, 5.1, 8.8)))
    background = (0.078, 0.361, 0.753)
    #: White squares, grey squares, the teapot.
    materials = (
        Material((1.0, 1.0, 1.0), kd=0.5, ks=0.5, shine=phong_power(30.0), ior=0.0),
        Material((0.5, 0.5, 0.5), kd=0.5, ks=0.5, shine=phong_power(30.0), ior=0.0),
        Material((1.0, 0.5, 0.1), kd=0.75, ks=0.25, shine=phong_power(37.0), ior=0.0),
    )

    @property
    def counts(self) -> dict[Kind, int]:
        n = self.size
        return {Kind.PATCH: 2 * len(PATCHES) * n * n - POINTED * n, Kind.POLYGON: n * n}

    @property
    def vertices(self) -> int:
        return 4 * self.size**2

    def tasks(self, limit: int = BLOCK_OBJECTS) -> Iterator[Task]:
        """Yield white squares, grey squares, then the patches: rows of up to `limit` objects."""
        n = self.size
        for material in (WHITE, GREY):
            for first, last in _rows(n, max(1, limit // n)):
                yield partial(self._squares, material, first, last)
        for patch in range(len(PATCHES)):
            for first, last in _rows(n, max(1, limit // (2 * n))):
                yield partial(self._triangles, patch, first, last)

    def fill(self, material: int) -> str:
        """Return the line that sets a material; at size 1 after white's, as the package does."""
        before = super().fill(WHITE) if (self.size, material) == (1, GREY) else ""
        return before + super().fill(material)

    def _squares(self, material: int, first: int, last: int, dtype: Scalar) -> Block:
        """Make the squares of one color in columns [first, last), column by column."""
        n = self.size
        column, row = np.divmod(np.arange(first * n, last * n), n)
        mine = (column + row) % 2 == (1 if material == WHITE else 0)
        x = column[mine, None] + np.array([0, 1, 1, 0])
        y = row[mine, None] + np.array([0, 0, 1, 1])
        vertices = np.zeros((len(x), 4, 3), dtype)
        vertices[..., 0] = BOARD * (2.0 * x / n - 1.0)
        vertices[..., 1] = BOARD * (2.0 * y / n - 1.0)
        materials = np.full(len(x), material, np.uint32)
        counts = np.full(len(x), 4, np.int64)
        records = vertices.reshape(-1, 3)
        return (Part(Kind.POLYGON, records, materials, np.arange(len(x)), counts),)

    def _triangles(self, patch: int, first: int, last: int, dtype: Scalar) -> Block:
        """Make the triangles of the cells in rows [first, last) of s, two a cell."""
        n = self.size
        grid = _grid(patch, np.arange(first, last + 1) / n, np.arange(n + 1) / n)
        s, t = np.divmod(np.arange((last - first) * n), n)
        at = s * (n + 1) + t
        corners = np.stack([at, at + 1, at + n + 2, at + n + 2, at + n + 1, at], axis=1)
        corners = corners.reshape(-1, 3)
        cusp = (np.abs(grid.points[..., :2]) <= CUSP).all(axis=-1)
        upper = grid.points[..., 2] > MIDDLE
        grid.normals[cusp & upper] = (0.0, 0.0, 1.0)
        grid.normals[cusp & ~upper] = (0.0, 0.0, -1.0)
        corners = corners[cusp.reshape(-1)[corners].sum(axis=1) < 2]
        columns = np.concatenate(
            [grid.points.reshape(-1, 3), grid.normals.reshape(-1, 3)], axis=1
        ).astype(dtype, copy=False)
        found = columns[corners]
        records = np.concatenate(
            [found[..., :3].reshape(-1, 9), found[..., 3:].reshape(-1, 9)], axis=1
        )
        n = len(records)
        return (Part(Kind.PATCH, records, np.full(n, COPPER, np.uint32), np.arange(n)),)


def _rows(n: int, step: int) -> Iterator[tuple[int, int]]:
    for first in range(0, n, step):
        yield first, min(first + step, n)


def _grid(patch: int, s: Array, t: Array) -> Grid:
    """Evaluate a patch at s x t: points, and unit normals (zero where a tangent vanishes)."""
    control = np.moveaxis(POINTS[PATCHES[patch]], -1, 0)
    basis = _times(_times(BEZIER, control), BEZIER.T)  # one matrix a coordinate
    powers, slopes = _powers(s), _slopes(s)
    across, along = _powers(t), _slopes(t)

    def at(left: Array, right: Array) -> Array:
        return np.moveaxis(_times(_times(left, basis), right.T), 0, -1)

    normals = np.cross(at(powers, along), at(slopes, across))
    length = np.sqrt((normals * normals).sum(axis=-1, keepdims=True))
    length[length == 0.0] = 1.0
    return Grid(at(powers, across), normals / length)


def _times(a: Array, b: Array) -> Array:
    """Return the product of matrices (..., m, 4) and (..., 4, n), summed from first to last.

    The package does so, and prints six digits of it: many coordinates lie between two of those.
    """
    terms = [a[..., :, k, None] * b[..., None, k, :] for k in range(4)]
    return ((terms[0] + terms[1]) + terms[2]) + terms[3]


def _powers(x: Array) -> Array:
    """Return the powers 3 to 0 of x, (n, 4)."""
    return np.stack([x * x * x, x * x, x, np.ones_like(x)], axis=1)


def _slopes(x: Array) -> Array:
    """Return the derivatives of the powers 3 to 0 of x, (n, 4)."""
    return np.stack([3.0 * (x * x), 2.0 * x, np.ones_like(x), np.zeros_like(x)], axis=1)
