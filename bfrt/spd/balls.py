"""SPD's balls: a sphere with nine smaller ones on it, each with nine on it, over a square floor.

A sphere of depth d has 9^d descendants in the last generation; the package writes a sphere, then
each child with all that hangs on it. So the scene of size n is 1 + 9 + ... + 9^n spheres, and the
floor. Children sit at the same nine directions, turned with the way from grandparent to parent.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from functools import partial
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from bfrt.records import Kind
from bfrt.spd._balls import CHILDREN, children, grow
from bfrt.spd.blocks import BLOCK_OBJECTS, Block, Part, Scalar, Task, square
from bfrt.spd.recipe import SpdScene, phong_power
from bfrt.store.hierarchy import Hierarchy
from bfrt.store.model import Camera, Light, Material

RADIUS = 0.5


class Ball(NamedTuple):
    """Holds a sphere that others hang on: (3,) center and direction from its parent, radius."""

    center: npt.NDArray[np.float64]
    direction: npt.NDArray[np.float64]
    radius: float


class Balls(SpdScene):
    """Makes the balls of `size` generations."""

    name = "balls"
    settled = 4
    hierarchy = Hierarchy(t=0.5)
    camera = Camera(eye=(2.1, 1.3, 1.7), at=(0.0, 0.0, 0.0), angle=45.0, hither=0.01)
    lights = (Light((4.0, 3.0, 2.0)), Light((1.0, -4.0, 4.0)), Light((-3.0, 1.0, 5.0)))
    background = (0.078, 0.361, 0.753)
    #: The floor's and the balls'.
    materials = (
        Material((1.0, 0.75, 0.33), kd=0.8, ks=0.0, shine=phong_power(0.0), ior=1.0),
        Material((1.0, 0.9, 0.7), kd=0.5, ks=0.5, shine=phong_power(37.0), ior=1.0),
    )

    @property
    def counts(self) -> dict[Kind, int]:
        return {Kind.SPHERE: descendants(self.size), Kind.POLYGON: 1}

    @property
    def vertices(self) -> int:
        return 4

    def tasks(self, limit: int = BLOCK_OBJECTS) -> Iterator[Task]:
        """Yield the floor, then parts of the tree that have up to `limit` balls."""
        yield partial(square, 12.0, -0.5)
        root = Ball(np.zeros(3), np.array([0.0, 0.0, 1.0]), RADIUS)
        yield from _tasks(root, self.size, limit)


def descendants(depth: int) -> int:
    """Return the number of balls of a part whose last generation is `depth` below its first."""
    return int((CHILDREN ** (depth + 1) - 1) // (CHILDREN - 1))


def _tasks(ball: Ball, depth: int, limit: int) -> Iterator[Task]:
    if depth == 0 or descendants(depth) <= limit:
        yield partial(_part, ball, depth)
        return
    yield partial(_part, ball, 0)
    centers, directions, radius = children(*ball, OFFSETS)
    for center, direction in zip(centers, directions, strict=True):
        yield from _tasks(Ball(center, direction, radius), depth - 1, limit)


def _part(ball: Ball, depth: int, dtype: Scalar) -> Block:
    """Make a ball and `depth` generations on it."""
    records = np.empty((descendants(depth), 4), dtype)
    grow(*ball, depth, OFFSETS, records)
    materials = np.ones(len(records), np.uint32)
    return (Part(Kind.SPHERE, records, materials, np.arange(len(records))),)


def _offsets() -> npt.NDArray[np.float64]:
    """Return nine directions of children about +z, (9, 3): three trios, a third turn apart."""
    d = 1.0 / math.sqrt(2.0)
    trio = np.array([(d, d, 0.0), (d, 0.0, -d), (0.0, d, -d)])
    # Three neighbors of a close packing, tilted about (1, -1, 0) until the last two lie flat.
    angle = math.asin(2.0 / math.sqrt(6.0))
    a, c, s = d, math.cos(angle), math.sin(angle)
    tilt = np.array(
        [
            [a * a + (1.0 - a * a) * c, -a * a * (1.0 - c), a * s],
            [-a * a * (1.0 - c), a * a + (1.0 - a * a) * c, a * s],
            [-a * s, -a * s, c],
        ]
    )
    third = 2.0 * math.pi / 3.0
    turns = [
        np.array(
            [
                [math.cos(k * third), math.sin(k * third), 0.0],
                [-math.sin(k * third), math.cos(k * third), 0.0],
                [0.0, 0.0, 1.0],
            ]
        )
        for k in range(3)
    ]
    return np.concatenate([trio @ tilt @ turn for turn in turns])


OFFSETS = _offsets()
