"""SPD's gears: n x n x n interlocked gears of 144-gons and their teeth, on a mirroring ground.

A gear of 36 teeth has an upper and a lower face of 144 vertices, and 144 quadrilaterals between
them. All gears are one of two, turned by half a tooth or not, moved to their places.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from functools import partial

import numpy as np
import numpy.typing as npt

from bfrt.records import Kind
from bfrt.spd.blocks import BLOCK_OBJECTS, Block, Part, Scalar, Task, square
from bfrt.spd.recipe import SpdScene, phong_power
from bfrt.store.hierarchy import Hierarchy
from bfrt.store.model import Camera, Light, Material, Vector

TEETH = 36
EDGE = 4 * TEETH
POLYGONS = EDGE + 2
VERTICES = 2 * EDGE + 4 * EDGE
#: Radii: what a gear reaches of its place, and what its teeth take of that.
REACH = 0.995
TOOTH = 0.1
THICKNESS = 0.1
#: A tooth's corners: angles from its middle in teeth, and whether they are on the outer edge.
PROFILE = ((-0.19, True), (0.19, True), (0.3, False), (0.7, False))

#: Colors come round after so many places on each axis; every fifth gear or so is of glass.
COLORS = 7
GLASSY = 5


class Gears(SpdScene):
    """Makes a block of `size` gears on a side."""

    name = "gears"
    settled = 4
    hierarchy = Hierarchy(t=0.5)
    camera = Camera(eye=(-1.1, -2.1, 2.6), at=(0.0, 0.0, 0.0), angle=45.0)
    lights = tuple(
        Light(position)
        for position in (
            (2.0, 4.0, 4.0),
            (-2.0, 4.0, 3.0),
            (2.0, -2.5, 2.5),
            (-1.0, -4.0, 2.0),
            (-1.111, -2.121, 2.626),
        )
    )
    background = (0.078, 0.361, 0.753)

    def __init__(self, size: int) -> None:
        super().__init__(size)
        n = min(size, COLORS)
        self._sides = n
        ground = Material((1.0, 0.85, 0.7), kd=0.3, ks=0.6, shine=phong_power(37.0), ior=0.0)
        gears = [
            material
            for z in range(n)
            for y in range(n)
            for x in range(n)
            for material in (_opaque(_color(x, y, z)), _glass(_color(x, y, z)))
        ]
        #: The ground's, then two for each color.
        self.materials = (ground, *gears)

    @property
    def counts(self) -> dict[Kind, int]:
        return {Kind.POLYGON: POLYGONS * self.size**3 + 1}

    @property
    def vertices(self) -> int:
        return VERTICES * self.size**3 + 4

    def tasks(self, limit: int = BLOCK_OBJECTS) -> Iterator[Task]:
        """Yield the ground, then gears of up to `limit` polygons; a gear is never cut."""
        yield partial(square, 2.0, 0.0)
        radius = 1.0 / (self.size - (self.size - 1) * TOOTH / 2.0)
        thickness = min(THICKNESS, 1.0 / (2.0 * self.size))
        models = np.stack([_gear(radius, thickness, turned) for turned in (0, 1)])
        total, step = self.size**3, max(1, limit // POLYGONS)
        for first in range(0, total, step):
            yield partial(self._part, models, radius, first, min(first + step, total))

    def _part(
        self,
        models: npt.NDArray[np.float64],
        radius: float,
        first: int,
        end: int,
        dtype: Scalar,
    ) -> Block:
        """Make the gears [first, end), x fastest."""
        n = self.size
        index = np.arange(first, end, dtype=np.int64)
        x, y, z = index % n, index // n % n, index // (n * n)
        places = np.empty((len(index), 1, 3))
        places[:, 0, 0] = radius - 1.0 + x * radius * (2.0 - TOOTH)
        places[:, 0, 1] = radius - 1.0 + y * radius * (2.0 - TOOTH)
        places[:, 0, 2] = 1.0 - z * (1.0 / n)
        vertices = models[(x + y + z) % 2] + places
        glass = (4 * x + 2 * y + z) % GLASSY == 0
        color = x % COLORS + self._sides * (y % COLORS + self._sides * (z % COLORS))
        materials = np.repeat((1 + 2 * color + glass).astype(np.uint32), POLYGONS)
        counts = np.tile(np.array([EDGE, *[4] * EDGE, EDGE], np.int64), len(index))
        records = vertices.reshape(-1, 3).astype(dtype, copy=False)
        return (Part(Kind.POLYGON, records, materials, np.arange(len(counts)), counts),)


def _color(x: int, y: int, z: int) -> Vector:
    """Return the color of a gear by its place; the largest component is 1."""
    parts = [
        0.01 + math.modf((3 * a + 2 * b + c + 1) * k / 7.0)[0]
        for a, b, c, k in ((x, y, z, 5.0), (y, z, x, 3.0), (z, x, y, 2.0))
    ]
    r, g, b = (part / max(parts) for part in parts)
    return (r, g, b)


def _opaque(color: Vector) -> Material:
    return Material(color, kd=1.0, ks=0.0, shine=phong_power(0.0), ior=0.0)


def _glass(color: Vector) -> Material:
    return Material(color, kd=0.2, ks=0.0, shine=phong_power(0.0), transmittance=0.8, ior=1.1)


def _gear(radius: float, thickness: float, turned: int) -> npt.NDArray[np.float64]:
    """Return the vertices of a gear's polygons about its center: upper face, sides, lower face.

    The lower face goes round the other way.
    """
    start = math.pi * turned / TEETH
    upper = _edge(radius, start, 1.0)
    lower = upper - (0.0, 0.0, thickness)
    after = np.roll(np.arange(EDGE), -1)
    sides = np.stack([upper, lower, lower[after], upper[after]], axis=1).reshape(-1, 3)
    below = _edge(radius, start, -1.0) - (0.0, 0.0, thickness)
    return np.concatenate([upper, sides, below])


def _edge(radius: float, start: float, way: float) -> npt.NDArray[np.float64]:
    """Return the 144 vertices of a face at z = 0, tooth by tooth."""
    tooth = way * 2.0 * math.pi / TEETH
    points = np.zeros((TEETH, len(PROFILE), 3))
    for k, (off, outer) in enumerate(PROFILE):
        angles = start + tooth * np.arange(TEETH) + tooth * off
        r = REACH * radius if outer else (1.0 - TOOTH) * radius
        points[:, k, 0] = r * np.cos(angles)
        points[:, k, 1] = r * np.sin(angles)
    return points.reshape(-1, 3)
