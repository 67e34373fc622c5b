"""Blocks: some ten thousand objects of a standard scene, made at once, kind by kind."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from bfrt.records import Kind
from bfrt.store.model import Vector

#: Objects of a block: 66,430 balls are the largest part of a tree of balls that is near 2^16.
BLOCK_OBJECTS = 70_000


class Part(NamedTuple):
    """Holds the objects of one kind in a block.

    Attributes
    ----------
    kind : Kind
        Which primitive.
    records : ndarray of float32 or float64, shape (n, SCALARS[kind])
        One object a row; for polygons one vertex a row.
    materials : ndarray of uint32, shape (n,)
        Indices into the scene's `materials`.
    places : ndarray of int64, shape (n,)
        Each object's place in the block, in the package's order over all kinds.
    counts : ndarray of int64, shape (n,), or None
        For polygons: the number of vertices of each.
    """

    kind: Kind
    records: npt.NDArray[Any]
    materials: npt.NDArray[np.uint32]
    places: npt.NDArray[np.int64]
    counts: npt.NDArray[np.int64] | None = None

    @property
    def vertex_counts(self) -> npt.NDArray[np.uint32]:
        """Return the number of vertices of each polygon, (n,); 0 for other kinds."""
        if self.counts is None:
            return np.zeros(len(self.materials), np.uint32)
        return self.counts.astype(np.uint32)


Block = tuple[Part, ...]

#: The dtype of coordinates: float64 is computed in any case, float32 is half the way to a store.
Scalar = type[np.float32] | type[np.float64]

#: Makes a block; any thread may do it.
Task = Callable[[Scalar], Block]


def square(half: float, z: float, dtype: Scalar) -> Block:
    """Make a level square about the z axis, of the scene's first material."""
    corners = [(half, half, z), (-half, half, z), (-half, -half, z), (half, -half, z)]
    return polygon(corners, dtype)


def polygon(corners: list[Vector], dtype: Scalar) -> Block:
    """Make one polygon, of the scene's first material."""
    part = Part(
        Kind.POLYGON,
        np.array(corners, dtype),
        materials=np.zeros(1, dtype=np.uint32),
        places=np.zeros(1, dtype=np.int64),
        counts=np.array([len(corners)], dtype=np.int64),
    )
    return (part,)
