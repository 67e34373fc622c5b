"""All hits of rays, not only the nearest: what becomes of them in a pass."""

from __future__ import annotations

import threading
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bfrt.phases.crossings import CrossingBuffer
from bfrt.records import LINE, QUERY_PATH, QUERY_RAY, RAY, plain

#: Crossings that a thread gathers before it hands them over.
ROOM = 4096

#: A query's ray by what is copied at once.
PARTS = np.dtype(
    [
        ("line", f"V{LINE.itemsize}"),
        ("t", "<f8"),
        ("id", "<u8"),
        ("path", f"V{QUERY_PATH.itemsize}"),
    ]
)

#: A ray in flight, of which its line is copied at once.
LINE_OF_RAY = np.dtype(
    {"names": ["line"], "formats": [f"V{LINE.itemsize}"], "itemsize": RAY.itemsize}
)


class AllHits:
    """Takes all hits of the rays in flight, in place of the nearest of each.

    Parameters
    ----------
    take : callable, optional
        Called with crossings (n,) of records.QUERY_RAY, by any thread. Without, they are counted,
        in the rays' own records.
    """

    def __init__(self, take: Callable[[NDArray[Any]], None] | None = None) -> None:
        self._take = take
        self._counting = threading.Lock()

    def attach(self, rays: NDArray[Any], paths: NDArray[Any]) -> None:
        """Take the memory of the rays in flight, (capacity,) of records.RAY and records.PATH."""
        self._lines = rays.view(LINE_OF_RAY)["line"]
        self._paths = paths.view(QUERY_PATH)

    def buffer(self) -> CrossingBuffer:
        """Return a buffer for one thread's crossings."""
        return CrossingBuffer(ROOM, self._hand_over)

    def _hand_over(self, found: NDArray[Any]) -> None:
        rays = found["ray"]
        if self._take is None:
            with self._counting:
                np.add.at(self._paths["count"], rays, 1)
            return
        queried = np.empty(len(found), PARTS)
        queried["line"] = self._lines[rays]
        queried["t"] = found["t"]
        queried["id"] = found["id"]
        queried["path"] = plain(self._paths)[rays]
        self._take(queried.view(QUERY_RAY))
