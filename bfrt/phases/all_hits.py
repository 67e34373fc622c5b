"""All hits of rays, not only the nearest: what becomes of them in a pass."""

from __future__ import annotations

import threading
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bfrt.records import ASKED, CROSSING, HIT_BYTES, PATH_BYTES, RAY_BYTES

#: Crossings that a thread gathers before it hands them over.
ROOM = 4096

LINE_BYTES = 48

Buffer = tuple[NDArray[Any], Callable[[int], None]]


class Crossings:
    """Takes all hits of the rays in flight, in place of the nearest of each.

    Parameters
    ----------
    take : callable, optional
        Called with crossings (n,) of records.ASKED, by any thread. Without, they are counted, in
        the rays' own records.
    """

    def __init__(self, take: Callable[[NDArray[Any]], None] | None = None) -> None:
        self._take = take
        self._counting = threading.Lock()

    def fly(self, rays: NDArray[Any], paths: NDArray[Any]) -> None:
        """Know the rays in flight, (capacity,) of records.RAY and records.PATH."""
        self._lines = rays.view(np.uint8).reshape(-1, RAY_BYTES)[:, :LINE_BYTES]
        self._paths = paths.view(np.uint8).reshape(-1, PATH_BYTES)
        start = ASKED.fields["count"][1] - (HIT_BYTES - PATH_BYTES)  # type: ignore[index]
        self._counts = self._paths[:, start : start + 4].view("<u4")[:, 0]

    def buffer(self) -> Buffer:
        """Return a buffer for one thread's crossings, and the function to call when it is full."""
        found = np.empty(ROOM, CROSSING)
        return found, lambda n: self._hand_over(found[:n])

    def _hand_over(self, found: NDArray[Any]) -> None:
        rays = found["ray"]
        if self._take is None:
            with self._counting:
                np.add.at(self._counts, rays, 1)
            return
        asked = np.empty(len(found), ASKED)
        memory = asked.view(np.uint8).reshape(-1, HIT_BYTES)
        memory[:, :LINE_BYTES] = self._lines[rays]
        memory[:, HIT_BYTES - PATH_BYTES :] = self._paths[rays]
        asked["t"] = found["t"]
        asked["id"] = found["id"]
        self._take(asked)
