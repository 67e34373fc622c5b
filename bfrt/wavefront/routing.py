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
