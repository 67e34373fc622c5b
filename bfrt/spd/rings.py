"""SPD's rings: a pyramid of dodecahedral chains of spheres and cylinders before a wall.

Each element has six pentagonal rings, which join the midpoints of a dodecahedron's edges; a ring is
five cylinders with a sphere at each joint. Layer d of the pyramid holds d x d elements, so that a
pyramid of n layers has 10 n (n + 1) (2n + 1) objects and its wall. The geometry and its order are
those of the SPD package.

An element e of layer d stands at x = 2 (e mod d) - (d - 1), z = 2 (e div d) - (d - 1) and at d
times the layers' distance along y.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from functools import partial

import numpy as np
import numpy.typing as npt

from bfrt.records import Kind
from bfrt.spd.blocks import BLOCK_OBJECTS, Block, Part, Scalar, Task, polygon
from bfrt.spd.recipe import SpdScene, phong_power
from bfrt.store.model import Camera, Light, Material

RADIUS = 0.07412
#: Between layers. It makes the pyramid's sides lean as those of a 45 degree view do.
DISTANCE = 1.0 / math.sin(math.pi / 8)
EYE = (-1.0, -DISTANCE, 0.5)

RING = 5
RINGS = 6
JOINTS = RING * RINGS
OBJECTS = 2 * JOINTS

WHITE = (1.0, 1.0, 1.0)
RING_COLORS = (
    (1.0, 0.0, 0.0),
    (0.0, 1.0, 0.0),
    (0.0, 0.0, 1.0),
    (0.0, 1.0, 1.0),
    (1.0, 0.0, 1.0),
    (1.0, 1.0, 0.0),
)


class Rings(SpdScene):
    """Makes the rings of `size` layers."""

    name = "rings"
    camera = Camera(eye=EYE, at=(EYE[0], EYE[1] + 1.0, EYE[2]), up=(0.0, 0.0, 1.0), angle=45.0)
    lights = (
        Light((3.0, -DISTANCE, 3.0)),
        Light((-4.0, -DISTANCE, 1.0)),
        Light((2.0, -DISTANCE, -4.0)),
    )
    background = (0.078, 0.361, 0.753)
    #: The wall's, then one for each ring of an element.
    materials = (
        Material(WHITE, kd=1.0, ks=0.0, shine=phong_power(0.0), ior=0.0),
        *(Material(c, kd=0.5, ks=0.2, shine=phong_power(37.0), ior=0.0) for c in RING_COLORS),
    )

    @property
    def counts(self) -> dict[Kind, int]:
        """Count 30 joints for each of 1 + 4 + 9 + ... + size x size elements, and the wall."""
        joints = JOINTS * self.size * (self.size + 1) * (2 * self.size + 1) // 6
        return {Kind.CONE: joints, Kind.SPHERE: joints, Kind.POLYGON: 1}

    @property
    def vertices(self) -> int:
        return 4

    @property
    def surface(self) -> float:
        """Return the surface of the box around all unit spheres; the last layer is the widest."""
        width, depth = 2.0 * self.size, DISTANCE * (self.size - 1) + 2.0
        return 2.0 * (width * width + 2.0 * width * depth)

    def tasks(self, limit: int = BLOCK_OBJECTS) -> Iterator[Task]:
        """Yield the wall, then the layers from the tip: blocks of up to `limit` objects.

        An element is never cut, so that a block has 60 objects at least.
        """
        yield self._wall
        joints = element_joints()
        step = max(1, limit // OBJECTS)
        for layer in range(1, self.size + 1):
            elements = layer * layer
            for first in range(0, elements, step):
                yield partial(_elements, joints, layer, first, min(first + step, elements))

    def _wall(self, dtype: Scalar) -> Block:
        """Make a square behind the last layer that fills the view and 1 % more."""
        y = DISTANCE * (self.size + 1)
        half = 1.01 * (y - EYE[1]) * math.tan(math.pi / 8)
        corners = [
            (EYE[0] + x * half, y, EYE[2] + z * half)
            for x, z in ((1, 1), (-1, 1), (-1, -1), (1, -1))
        ]
        return polygon(corners, dtype)


def element_joints() -> npt.NDArray[np.float64]:
    """Return the 30 sphere centers of an element about the origin, ring by ring, shape (30, 3)."""
    scale = 1.0 / (1.0 + RADIUS)  # the element fits in a unit sphere, its spheres included
    corners = [k * 2.0 * math.pi / RING for k in range(RING)]
    flat = np.array([(scale * math.cos(a), scale * math.sin(a), 0.0) for a in corners])
    # The angle between two neighbor faces of a dodecahedron.
    tilt = 2.0 * math.acos(math.cos(math.pi / 3) / math.sin(math.pi / RING))
    tilted = _rotated(flat, tilt, 1, 2)
    turns = [math.pi * (2.0 * k + 1.0) / RING for k in range(RINGS - 1)]
    return np.concatenate([flat, *(_rotated(tilted, turn, 0, 1) for turn in turns)])


def _rotated(
    points: npt.NDArray[np.float64], angle: float, a: int, b: int
) -> npt.NDArray[np.float64]:
    """Return the points turned by `angle` from axis `a` towards axis `b`."""
    cosine, sine = math.cos(angle), math.sin(angle)
    turned = points.copy()
    turned[:, a] = points[:, a] * cosine + points[:, b] * -sine
    turned[:, b] = points[:, a] * sine + points[:, b] * cosine
    return turned


def _elements(
    joints: npt.NDArray[np.float64], layer: int, first: int, end: int, dtype: Scalar
) -> Block:
    """Make the elements `first` to `end` of a layer: a cylinder and a sphere for each joint."""
    index = np.arange(first, end, dtype=np.int64)
    offsets = np.empty((len(index), 1, 3))
    offsets[:, 0, 0] = 2 * (index % layer) - (layer - 1)
    offsets[:, 0, 1] = DISTANCE * layer
    offsets[:, 0, 2] = 2 * (index // layer) - (layer - 1)
    spheres = np.empty((len(index), JOINTS, 4), dtype)
    spheres[..., :3] = joints + offsets
    spheres[..., 3] = RADIUS
    # A cylinder ends at the joint before its own, in its ring.
    rings = spheres.reshape(-1, RING, 4)
    cones = np.empty((len(rings), RING, 8), dtype)
    cones[..., :4] = rings
    cones[:, 0, 4:] = rings[:, -1]
    cones[:, 1:, 4:] = rings[:, :-1]
    count = len(index) * JOINTS
    materials = np.tile(np.repeat(np.arange(1, RINGS + 1, dtype=np.uint32), RING), len(index))
    places = np.arange(count, dtype=np.int64)
    return (
        Part(Kind.CONE, cones.reshape(count, 8), materials, 2 * places),
        Part(Kind.SPHERE, spheres.reshape(count, 4), materials, 2 * places + 1),
    )
