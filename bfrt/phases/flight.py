"""Rays in flight between two passes: what is saved of them, and how they go on.

Between passes a ray is its line, its nearest hit so far and its sentinel, where the next pass
begins for it. A sentinel is a voxel of a grid, or a treelet: it means something to a tracer of the
same grid alone. With another, as another budget may have one, or where memory is too small for all
of them, rays begin again with the hit that they have.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from bfrt.checkpoint.soundness import expect
from bfrt.checkpoint.state import SavedState, StateWriter
from bfrt.errors import CheckpointError
from bfrt.records import HIT, LINE, PATH, RAY

RAYS, PATHS = "rays", "paths"

#: Records of rays by what is copied at once.
_RAY_PARTS = np.dtype(
    {
        "names": ["line", "t", "id"],
        "formats": [f"V{LINE.itemsize}", "<f8", "<u8"],
        "itemsize": RAY.itemsize,
    }
)
_HIT_PARTS = np.dtype(
    [("line", f"V{LINE.itemsize}"), ("t", "<f8"), ("id", "<u8"), ("path", f"V{PATH.itemsize}")]
)


class Pool(Protocol):
    """Holds rays in flight."""

    @property
    def active(self) -> int: ...
    @property
    def capacity(self) -> int: ...
    @property
    def all(self) -> tuple[NDArray[Any], NDArray[Any]]: ...
    def come(self, n: int) -> None: ...


def save_flight(pool: Pool, writer: StateWriter) -> None:
    """Save the rays in flight."""
    for name, records in zip((RAYS, PATHS), pool.all, strict=True):
        writer.put(name, [records[: pool.active]])


def restore_flight(pool: Pool, saved: SavedState, voxels: int) -> None:
    """Bring saved rays into an empty pool, which has room for them, to where they were.

    Parameters
    ----------
    voxels : int
        The number of voxels, or treelets, which sentinels are.
    """
    n = saved.count(RAYS, RAY)
    for name, records in zip((RAYS, PATHS), pool.all, strict=True):
        saved.fill(name, records[:n])
    if (pool.all[0]["voxel"][:n] >= voxels).any():
        raise CheckpointError(f"{saved.folder / RAYS}: found a sentinel that is not in the grid")
    pool.come(n)


class BegunAgain:
    """Queues saved rays, which begin again, with the nearest hits that they have."""

    def __init__(self, saved: SavedState) -> None:
        self._left = saved.count(RAYS, RAY)
        paths = saved.count(PATHS, PATH)
        expect(saved.folder / PATHS, "rays", paths, right=paths == self._left)
        self._records = self._hits_of(saved)
        self._some = np.empty(0, HIT)

    def __len__(self) -> int:
        """Return the number of rays that wait."""
        return self._left

    def read(self, most: int) -> NDArray[Any]:
        """Return the next rays, (n,) of records.HIT with n <= most."""
        if not len(self._some) and self._left:
            self._some = next(self._records)
        some, self._some = self._some[:most], self._some[most:]
        self._left -= len(some)
        return some

    @staticmethod
    def _hits_of(saved: SavedState) -> Iterator[NDArray[Any]]:
        paths = saved.blocks(PATHS, PATH)
        waiting = np.empty(0, PATH)
        for rays in saved.blocks(RAYS, RAY):
            while len(waiting) < len(rays):
                waiting = np.concatenate([waiting, next(paths)])
            made = np.empty(len(rays), _HIT_PARTS)
            parts = rays.view(_RAY_PARTS)
            for name in ("line", "t", "id"):
                made[name] = parts[name]
            made["path"] = waiting[: len(rays)].view(f"V{PATH.itemsize}")
            waiting = waiting[len(rays) :]
            yield made.view(HIT)
