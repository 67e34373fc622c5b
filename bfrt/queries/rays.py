"""The rays of a query as a queue of records, made as they are taken."""

from __future__ import annotations

import zlib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bfrt.checkpoint.state import Facts
from bfrt.errors import SettingError
from bfrt.queries._rays import RayRecords
from bfrt.queries.given import RAYS_AT_ONCE, Block
from bfrt.records import HIT, QUERY_RAY, RayKind
from bfrt.store.store import Store


class RayQueue:
    """Queues the rays of a query, and makes them into records as they are taken.

    Parameters
    ----------
    checked : bool
        Whether their checksums are taken too: of origins, directions, and each end.

    Attributes
    ----------
    taken : int
        Rays taken so far.
    """

    def __init__(
        self, store: Store, blocks: Iterator[Block], kind: RayKind, *, checked: bool = False
    ) -> None:
        empty = store.bounds.empty
        bounds = np.zeros((2, 3)) if empty else np.stack([store.bounds.lo, store.bounds.hi])
        self._records = RayRecords(store.origin, bounds, kind)
        self._blocks = blocks
        self._at = 0
        self._block: Block | None = None
        self._bad: list[int] = []
        self._checked = checked
        self._checks = [0] * 4
        self.taken = 0
        self._next()

    @property
    def bad(self) -> int:
        """Return the number of rays so far that are NaN, infinite or of no length."""
        return sum(self._bad)

    def _next(self) -> None:
        """Come to the next block that has rays."""
        self._at = 0
        self._block = next((block for block in self._blocks if len(block[0])), None)

    def __len__(self) -> int:
        """Return the waiting rays of the current block: 0 when there are no more at all."""
        return 0 if self._block is None else len(self._block[0]) - self._at

    def read(self, most: int) -> NDArray[Any]:
        """Return the next rays, (n,) of records.HIT with n <= most, with paths of QUERY_RAY."""
        first = self.taken
        block = self.take(most)
        return self.records(block, 0, len(block[0]), first).view(HIT)

    def go_on(self, folder: Path, saved: Facts) -> None:
        """Go on behind the rays that were taken before, which must be the same.

        Parameters
        ----------
        folder : Path
            The checkpoint's, for an error.
        saved : dict
            What `facts` returned.

        Raises
        ------
        SettingError
            If they are not.
        """
        taken = saved["taken"]
        while self.taken < taken and len(self):
            self.take(min(RAYS_AT_ONCE, taken - self.taken))
        if self.taken < taken:
            raise SettingError(
                f"checkpoint: {folder}: found {self.taken} rays, expected the {taken} or more that "
                "the work was begun with"
            )
        if self._checks != saved["checksums"]:
            raise SettingError(
                f"checkpoint: {folder}: found other rays among the first {taken} than the work was "
                "begun with, expected the same: go on as it was begun, or name another folder"
            )
        self._bad.append(saved["bad"])

    def facts(self) -> Facts:
        """Return how many rays were taken, of which so many were bad, and their checksums."""
        return {"taken": self.taken, "bad": self.bad, "checksums": [*self._checks]}

    def take(self, most: int) -> Block:
        """Return the next rays as they are given, `most` at the most."""
        n = min(most, len(self))
        if self._block is None:
            none = np.empty(0)
            return none.reshape(0, 3), none.reshape(0, 3), none, none
        o, d, near, far = self._block
        part = slice(self._at, self._at + n)
        self._at += n
        self.taken += n
        if self._at == len(o):
            self._next()
        taken = o[part], d[part], near[part], far[part]
        if self._checked:
            for k, given in enumerate(taken):
                self._checks[k] = zlib.crc32(np.ascontiguousarray(given).data, self._checks[k])
        return taken

    def records(self, block: Block, first: int, last: int, number: int) -> NDArray[Any]:
        """Make rays [first, last) of a block into records.QUERY_RAY; any thread may.

        Parameters
        ----------
        number : int
            Of the first.
        """
        out = np.empty(last - first, QUERY_RAY)
        o, d, near, far = [np.ascontiguousarray(c[first:last], np.float64) for c in block]
        bad = self._records.fill(o, d, near, far, number, out)
        if bad:
            self._bad.append(bad)
        return out
