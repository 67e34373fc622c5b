"""SPD's mount: a fractal mountain with four crystal balls over it.

A square of 2^n x 2^n cells is halved n times; each new point is the mean of its neighbors plus
noise in proportion to the side, taken from a hash of where it is. So any part of the surface can be
made from its four corners alone. A cell is two triangles, and cells come in the order of the
halving: lower left, lower right, upper right, upper left.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from functools import lru_cache, partial
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from bfrt.errors import SettingError
from bfrt.records import Kind
from bfrt.spd._mount import Noise, triangles
from bfrt.spd.blocks import BLOCK_OBJECTS, Block, Part, Scalar, Task
from bfrt.spd.recipe import SpdScene, phong_power
from bfrt.store.model import Camera, Light, Material

DIMENSION = 2.2
NUMBER = 21  # of the mountain: another seed makes another one
CORNER, SIDE = -1.0, 2.0

#: Noise per side of a square, such that the surface has the fractal dimension.
ROUGHNESS = math.sqrt((2.0 / math.exp(math.log(2.0) / (DIMENSION - 1.0))) ** 2 - 1.0)

HASHES = ("package", "jenkins")


class Square(NamedTuple):
    """Holds a square of cells: its lower left corner, its side, and heights at its corners."""

    x: int
    y: int
    side: int
    ll: float
    lr: float
    ur: float
    ul: float


class Mount(SpdScene):
    """Makes the mountain of 2^size x 2^size cells.

    Parameters
    ----------
    size : int
        The package's size factor.
    hash : {"package", "jenkins"}
        Where the noise comes from: the package's first hash, whose regularity one sees, or the
        better one that it has an option for, and that the paper used.
    """

    name = "mount"
    settled = 7
    camera = Camera(eye=(-1.6, 1.6, 1.7), at=(0.0, 0.0, 0.0), angle=45.0, hither=0.01)
    lights = (Light((-100.0, -100.0, 100.0)),)
    background = (0.078, 0.361, 0.753)
    #: The balls' and the mountain's.
    materials = (
        Material(
            (1.0, 1.0, 1.0), kd=0.1, ks=0.1, shine=phong_power(6.7), transmittance=0.9, ior=1.5
        ),
        Material((0.5, 0.45, 0.35), kd=1.0, ks=0.0, shine=phong_power(0.0), ior=0.0),
    )

    def __init__(self, size: int, hash: str = HASHES[0]) -> None:
        super().__init__(size)
        if hash not in HASHES:
            raise SettingError(f"mount: found hash {hash!r}, expected one of {', '.join(HASHES)}")
        self.hash = hash

    @property
    def counts(self) -> dict[Kind, int]:
        return {Kind.SPHERE: 4, Kind.TRIANGLE: 2 * 4**self.size}

    def _small(self) -> Mount:
        return Mount(min(self.size, self.settled), self.hash)

    def tasks(self, limit: int = BLOCK_OBJECTS) -> Iterator[Task]:
        """Yield the balls, then squares of up to `limit` triangles."""
        yield _crystals
        yield from self._tasks(Square(0, 0, 1 << self.size, 0.0, 0.0, 0.0, 0.0), limit)

    def _tasks(self, square: Square, limit: int) -> Iterator[Task]:
        if square.side == 1 or 2 * square.side**2 <= limit:
            yield partial(self._part, square)
            return
        x, y, half = square.x, square.y, square.side // 2
        z = self._halved(np.array([[square.ll, square.lr], [square.ul, square.ur]]), square)
        for i, j in QUARTERS:
            part = z[j : j + 2, i : i + 2].ravel().tolist()
            ll, lr, ul, ur = part
            yield from self._tasks(Square(x + i * half, y + j * half, half, ll, lr, ur, ul), limit)

    def _part(self, square: Square, dtype: Scalar) -> Block:
        """Make the triangles of a square, two a cell."""
        cells = square.side
        z = np.array([[square.ll, square.lr], [square.ul, square.ur]])
        while square.side > 1:
            z = self._halved(z, square)
            square = square._replace(side=square.side // 2)
        n = 2 * cells * cells
        records = np.empty((n, 9), dtype)
        triangles(z, self._along(square.x, cells), self._along(square.y, cells), records)
        return (Part(Kind.TRIANGLE, records, np.ones(n, np.uint32), np.arange(n)),)

    def _along(self, first: int, cells: int) -> npt.NDArray[np.float64]:
        """Return the coordinates of the corners of `cells` cells along an axis."""
        return CORNER + (first + np.arange(cells + 1.0)) * SIDE / (1 << self.size)

    def _halved(self, z: npt.NDArray[np.float64], square: Square) -> npt.NDArray[np.float64]:
        """Return heights (2m + 1, 2m + 1), row by row in y, from heights (m + 1, m + 1) of squares
        of `square.side` that begin at `square`.
        """
        finer = np.empty((2 * len(z) - 1, 2 * len(z) - 1))
        rise = square.side // 2 * SIDE / (1 << self.size) * ROUGHNESS
        _noise(self.size, self.hash).halve(z, square.x, square.y, square.side, rise, finer)
        return finer


#: The quarters of a square in the order of the halving, (x, y).
QUARTERS = ((0, 0), (1, 0), (1, 1), (0, 1))


@lru_cache(maxsize=4)
def _noise(size: int, hash: str) -> Noise:
    return Noise(size, hash == "jenkins", _gauss())


@lru_cache(maxsize=1)
def _gauss() -> npt.NDArray[np.float64]:
    """Return every seed's normal deviate: Box and Muller, linear congruential generator."""
    modulus, factor, step = 134456, 8121, 28411
    seed = NUMBER + np.arange(1 << 16, dtype=np.int64)
    deviates = np.empty(len(seed))
    left = np.arange(len(seed))
    while len(left):
        first = (step + seed[left] * factor) % modulus
        seed[left] = second = (step + first * factor) % modulus
        u = first * 2.0 / modulus - 1.0
        v = second * 2.0 / modulus - 1.0
        r = u * u + v * v
        inside = r < 1.0
        u, r = u[inside], r[inside]
        deviates[left[inside]] = u * np.sqrt(-2.0 * np.log(r) / r)
        left = left[~inside]
    return deviates


def _crystals(dtype: Scalar) -> Block:
    """Make four balls at the corners of a tetrahedron."""
    center, radius = np.array([-0.8, 0.8, 1.0]), 0.17
    height = radius * math.sqrt(1.5)
    # The top one, turned about (1, 1, 0) to where the others are, and thirds of a turn from there.
    tilt = math.acos(-1.0 / 3.0)
    down = height * math.sin(tilt) * math.sqrt(0.5), -height * math.sin(tilt) * math.sqrt(0.5)
    spots = [(0.0, 0.0, height)]
    for k in range(3):
        c, s = math.cos(k * 2.0 * math.pi / 3.0), math.sin(k * 2.0 * math.pi / 3.0)
        spots.append(
            (down[0] * c - down[1] * s, down[0] * s + down[1] * c, height * math.cos(tilt))
        )
    records = np.full((4, 4), radius, dtype)
    records[:, :3] = center + np.array(spots)
    return (Part(Kind.SPHERE, records, np.zeros(4, np.uint32), np.arange(4)),)
