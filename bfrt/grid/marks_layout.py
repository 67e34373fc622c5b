"""What a file of marks is of, and where in it what lies."""

from __future__ import annotations

import math
import struct
from typing import NamedTuple

from bfrt.grid._coding import MOST_CODED
from bfrt.grid.bricks import BRICK

HEADER = struct.Struct("<8sI3IIIQII")
CRC = struct.Struct("<I")

#: Of each layer, its checksum and size.
LAYER_BYTES = 4 + 8

Shape = tuple[int, int, int]


def bricks_of(layered: Shape) -> Shape:
    """Return the number of bricks an axis, for a number of voxels an axis."""
    a, b, c = (-(-n // BRICK) for n in layered)
    return (a, b, c)


class Layout(NamedTuple):
    """Identifies what marks describe: a grid, and the boxes marked in it.

    Attributes
    ----------
    shape : tuple of 3 int
        Voxels an axis: x, y, z.
    axis : int
        The one across the layers.
    boxes : int
        0 for the objects' boxes as they are; else `Group.quantised_checksum`.
    """

    shape: Shape
    axis: int
    boxes: int = 0

    @property
    def bricks(self) -> Shape:
        """Return the number of bricks: (layers, rows of a layer, bricks of a row)."""
        rest = [n for k, n in enumerate(self.shape) if k != self.axis]
        return bricks_of((self.shape[self.axis], rest[1], rest[0]))

    @property
    def data_at(self) -> int:
        """Return the offset of the first brick in the file, bytes."""
        bits = -(-math.prod(self.bricks) // 8)
        return HEADER.size + CRC.size + LAYER_BYTES * self.bricks[0] + bits

    def most_bytes(self, bricks: int) -> int:
        """Return an upper bound of the file's bytes for a number of bricks."""
        return self.data_at + bricks * MOST_CODED
