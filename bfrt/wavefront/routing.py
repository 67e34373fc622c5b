"""Where rays go: which boxes each of them meets, and from where on."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bfrt.phases.preprocess import padding_of
from bfrt.shards.manifest import Shard
from bfrt.store.store import Store

#: Shards' boxes are grown by more than objects' boxes are, by so many times the padding: what is
#: rounded here otherwise than in the kernels loses no ray.
GROWN = 2.0

#: Crossings of rays and shards that are worked out at once: 8 MB of each of some arrays.
AT_ONCE = 1 << 20

#: The carrier of a ray that goes nowhere any more.
NOWHERE = -1

Boxes = NDArray[np.float64]


def boxes_of(store: Store, shards: Sequence[Shard]) -> Boxes:
    """Return the boxes of shards, grown, (n, 2, 3) float64 relative to the scene's origin."""
    grown = GROWN * padding_of(store) * np.array([[-1.0], [1.0]])
    return np.array([np.stack(shard.bounds) + grown for shard in shards]).reshape(-1, 2, 3)


def entries(rays: NDArray[Any], boxes: Boxes) -> NDArray[np.float64]:
    """Return where rays come into boxes.

    Parameters
    ----------
    rays : (n,) records.QUERY_RAY or records.HIT
    boxes : (m, 2, 3) float64
        Lower and higher corners.

    Returns
    -------
    (n, m) float64
        0 where a ray begins inside; inf where it misses the box.
    """
    near = np.full((len(rays), len(boxes)), -np.inf)
    far = np.full((len(rays), len(boxes)), np.inf)
    with np.errstate(all="ignore"):
        for axis, (origin, direction) in enumerate((("ox", "dx"), ("oy", "dy"), ("oz", "dz"))):
            o, d = rays[origin][:, None], rays[direction][:, None]
            low, high = boxes[None, :, 0, axis], boxes[None, :, 1, axis]
            inside = (low <= o) & (o <= high)
            one, other = (low - o) / d, (high - o) / d
            first = np.where(inside & (d == 0), -np.inf, np.fmin(one, other))
            last = np.where(inside & (d == 0), np.inf, np.fmax(one, other))
            # Beside the box, a ray along its faces has both crossings at one infinity.
            near, far = np.fmax(near, first), np.fmin(far, last)
        empty = boxes[None, :, 0, 0] > boxes[None, :, 1, 0]
        missed = (near > far) | (far < 0.0) | (near == np.inf) | empty
    return np.where(missed, np.inf, np.fmax(near, 0.0))


def carrier_entries(rays: NDArray[Any], boxes: Sequence[Boxes]) -> NDArray[np.float64]:
    """Return where rays come to the shards of each carrier, (n, carriers); as `entries`."""
    return np.stack([entries(rays, own).min(axis=1) for own in boxes], axis=1)


class Route:
    """Holds which carriers each ray of a block still has to go to, the nearest first.

    It takes 12 bytes for each carrier that a ray meets: of many carriers a ray meets few.

    Parameters
    ----------
    rays : (n,) records.HIT
    boxes : sequence of (m, 2, 3) float64
        Of each carrier's shards.
    """

    def __init__(self, rays: NDArray[Any], boxes: Sequence[Boxes]) -> None:
        step = max(1, AT_ONCE // max(1, sum(map(len, boxes))))
        parts = [
            _by_nearness(carrier_entries(rays[first : first + step], boxes))
            for first in range(0, len(rays), step)
        ]
        counts = np.concatenate([np.empty(0, np.int64), *(count for count, _, _ in parts)])
        # Behind the last there is one that nobody comes to.
        self._near = np.concatenate([*(near for _, near, _ in parts), [np.inf]])
        self._carriers = np.concatenate(
            [*(carriers for _, _, carriers in parts), np.array([NOWHERE], np.int32)]
        )
        self._last = np.cumsum(counts)
        self._next = self._last - counts

    def next(self, which: NDArray[np.int64], ends: NDArray[np.float64]) -> NDArray[np.int32]:
        """Return the carrier that each of some rays goes to now.

        Parameters
        ----------
        which : (k,) int64
            The rays, each once.
        ends : (k,) float64
            Where they end: they go no further, but to what begins there.

        Returns
        -------
        (k,) int32
            `NOWHERE` for those that are through.
        """
        at = self._next[which]
        goes = (at < self._last[which]) & (self._near[at] <= ends)
        self._next[which] += goes
        return np.where(goes, self._carriers[at], np.int32(NOWHERE))


def _by_nearness(
    met: NDArray[np.float64],
) -> tuple[NDArray[np.int64], NDArray[np.float64], NDArray[np.int32]]:
    """Return how many carriers each ray meets; and, ray by ray, where, and which they are."""
    order = np.argsort(met, axis=1, kind="stable")
    near = np.take_along_axis(met, order, axis=1)
    reached = near < np.inf
    return reached.sum(axis=1), near[reached], order[reached].astype(np.int32)
