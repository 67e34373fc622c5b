"""SPD's tree: a branch that forks into two smaller ones, each of which forks again.

A branch is a cone with a sphere at its end, from (0, 0, 0) to (0, 0, 1) in its own frame. A fork's
frames are the branch's own times one of two matrices (row vectors: the newest on the left), so a
part of the tree is one list of matrices, whatever branch it grows on. Size n is 2^(n + 1) - 1
branches, and the field they stand on.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from functools import lru_cache, partial
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from bfrt.records import Kind
from bfrt.spd.blocks import BLOCK_OBJECTS, Block, Part, Scalar, Task, square
from bfrt.spd.recipe import SpdScene, phong_power
from bfrt.store.hierarchy import Hierarchy
from bfrt.store.model import Camera, Light, Material

#: Of each fork: degrees that it leans, degrees that it turns, its length in that of its parent.
FORKS = ((40.0, 90.0, 0.65), (25.0, 230.0, 0.70))
#: A branch's radius at its base in its scale, and what it narrows to.
WIDTH = 0.15
NARROWER = 0.67

Matrix = npt.NDArray[np.float64]


class Tree(SpdScene):
    """Makes the tree of `size` generations of forks."""

    name = "tree"
    settled = 12
    hierarchy = Hierarchy(t=0.5)
    camera = Camera(eye=(4.5, 0.4, 2.0), at=(0.0, 0.0, 1.5), angle=45.0)
    lights = tuple(
        Light(position)
        for position in (
            (-5.0, 5.0, 50.0),
            (30.0, -30.0, 30.0),
            (-40.0, -30.0, 20.0),
            (10.0, 30.0, 40.0),
            (-30.0, 40.0, 10.0),
            (50.0, 25.0, 20.0),
            (-10.0, -60.0, 30.0),
        )
    )
    background = (0.078, 0.361, 0.753)
    #: The field's and the tree's.
    materials = (
        Material((0.2, 0.7, 0.2), kd=1.0, ks=0.0, shine=phong_power(0.0), ior=0.0),
        Material((0.55, 0.4, 0.2), kd=1.0, ks=0.0, shine=phong_power(0.0), ior=0.0),
    )

    @property
    def counts(self) -> dict[Kind, int]:
        branches = branches_of(self.size)
        return {Kind.SPHERE: branches, Kind.CONE: branches, Kind.POLYGON: 1}

    @property
    def vertices(self) -> int:
        return 4

    def tasks(self, limit: int = BLOCK_OBJECTS) -> Iterator[Task]:
        """Yield the field, then parts of the tree of up to `limit` objects."""
        yield partial(square, 50.0, 0.0)
        yield from _tasks(np.eye(4), 1.0, self.size, limit)


def branches_of(depth: int) -> int:
    """Return the number of branches of a part with `depth` generations of forks."""
    return int(2 ** (depth + 1) - 1)


def _tasks(frame: Matrix, scale: float, depth: int, limit: int) -> Iterator[Task]:
    if depth == 0 or 2 * branches_of(depth) <= limit:
        yield partial(_part, frame, scale, depth)
        return
    yield partial(_part, frame, scale, 0)
    for fork in _forks():
        yield from _tasks(fork @ frame, scale * NARROWER, depth - 1, limit)


def _part(frame: Matrix, scale: float, depth: int, dtype: Scalar) -> Block:
    """Make a branch with `depth` generations of forks: a cone and a sphere for each."""
    frames = _frames(depth)
    ends = frames.ends @ frame[:, :3]
    radii = scale * WIDTH * frames.scales
    cones = np.empty((len(radii), 8), dtype)
    cones[:, :3] = ends[0]
    cones[:, 3] = radii
    cones[:, 4:7] = ends[1]
    cones[:, 7] = radii * NARROWER
    materials = np.ones(len(radii), np.uint32)
    places = 2 * np.arange(len(radii))
    return (
        Part(Kind.CONE, cones, materials, places),
        Part(Kind.SPHERE, np.ascontiguousarray(cones[:, 4:]), materials, places + 1),
    )


class Frames(NamedTuple):
    """Holds the branches of a part, in its first one's frame, in the package's order."""

    ends: npt.NDArray[np.float64]  # (2, n, 4): base and apex, homogeneous
    scales: npt.NDArray[np.float64]  # (n,)


@lru_cache(maxsize=4)
def _frames(depth: int) -> Frames:
    """Compute the branches of a part; a branch comes before its forks, each with all its own."""
    n = branches_of(depth)
    frames, scales = np.empty((n, 4, 4)), np.empty(n)
    now, places = np.eye(4)[None], np.zeros(1, np.int64)
    for generation in range(depth + 1):
        frames[places], scales[places] = now, NARROWER**generation
        if generation < depth:
            now = np.matmul(_forks(), now[:, None]).reshape(-1, 4, 4)
            after = 1 + np.array([0, branches_of(depth - generation - 1)])
            places = (places[:, None] + after).reshape(-1)
    base, apex = frames[:, 3], frames[:, 2] + frames[:, 3]
    return Frames(np.stack([base, apex]), scales)


@lru_cache(maxsize=1)
def _forks() -> Matrix:
    """Return the frames of the two forks in their parent's, (2, 4, 4)."""
    forks = []
    for lean, turn, contraction in FORKS:
        leaning, turning, end = np.eye(4), np.eye(4), np.eye(4)
        a, b = math.radians(lean), math.radians(turn)
        leaning[1:3, 1:3] = [[math.cos(a), math.sin(a)], [-math.sin(a), math.cos(a)]]
        turning[:2, :2] = [[math.cos(b), math.sin(b)], [-math.sin(b), math.cos(b)]]
        end[:3, :3] *= contraction
        end[3, 2] = 1.0
        forks.append(leaning @ turning @ end)
    return np.stack(forks)
