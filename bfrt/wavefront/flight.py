"""Blocks of rays under way: each goes from carrier to carrier, and many go at once."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bfrt.cluster.counters import Part, summed
from bfrt.cluster.watching import Errand, Watch
from bfrt.queries.casting import record_of_miss
from bfrt.queries.extras import NO_EXTRAS, Extras
from bfrt.queries.surfaces import SURFACE
from bfrt.records import QUERY_RAY
from bfrt.wavefront.cargo import BLOCK, Cargo
from bfrt.wavefront.carriers import Carrier
from bfrt.wavefront.routing import Boxes, carrier_entries
from bfrt.wavefront.tasks import Find, Trace, Traced
from bfrt.wavefront.travel import Travel, TravelStats
from bfrt.wavefront.window import AHEAD

Records = NDArray[Any]


class Block:
    """Holds the rays of a block, where they still have to go, and what they have found.

    Parameters
    ----------
    rays : (n,) records.QUERY_RAY
        Of consecutive numbers.
    entries : (n, carriers) float64
        Where each comes to a carrier's shards.
    find : Find
    extras : Extras

    Attributes
    ----------
    found : ndarray
        NEAREST: (n,) of SURFACE with the extras, whose key is `NO_HIT` for a miss. ANY: (n,) bool.
        COUNT: (n,) int64. ALL: (m,) of SURFACE, in any order.
    """

    def __init__(
        self,
        rays: Records,
        entries: NDArray[np.float64],
        find: Find,
        extras: Extras = NO_EXTRAS,
    ) -> None:
        self.rays = rays
        self.first = int(rays["number"][0])
        self._entries = entries
        self._find = find
        self.found: Records = _nothing(len(rays), find, extras)

    def departures(self) -> Iterator[tuple[int, NDArray[np.int64]]]:
        """Yield carriers, and the rays that go to each next: none goes to two where one is enough.

        A ray that begins behind its end, as a bad one does, goes nowhere.
        """
        goes = self._entries <= self.rays["t"][:, None]
        goes &= self._entries < np.inf
        if self._find in (Find.NEAREST, Find.ANY):
            nearest = self._entries.argmin(axis=1)
            goes &= np.arange(goes.shape[1]) == nearest[:, None]
        for carrier in np.flatnonzero(goes.any(axis=0)).tolist():
            rays = np.flatnonzero(goes[:, carrier])
            self._entries[rays, carrier] = np.inf
            yield carrier, rays

    def take(self, records: Records) -> None:
        """Take what a carrier has found."""
        if self._find is Find.ALL:
            self.found = np.concatenate([self.found, records])
            return
        at = records["number"].astype(np.int64) - self.first
        if self._find is Find.COUNT:
            self.found[at] += records["count"]
        elif self._find is Find.ANY:
            self.found[at] = True
            self.rays["t"][at] = -1.0
        else:
            self.rays["t"][at], self.rays["id"][at] = records["near"], records["id"]
            for name in self.found.dtype.names or ():
                self.found[name][at] = records[name]


def _nothing(n: int, find: Find, extras: Extras) -> Records:
    """Return what a block has found before it departs."""
    if find is Find.ANY:
        return np.zeros(n, np.bool_)
    if find is Find.COUNT:
        return np.zeros(n, np.int64)
    if find is Find.ALL:
        return np.empty(0, SURFACE)
    return np.repeat(record_of_miss(extras), n)


class Flights:
    """Takes blocks of rays to carriers and back, several at once, and yields them in order.

    Parameters
    ----------
    watch : Watch
    carriers : list of Carrier
    boxes : list of (m, 2, 3) float64
        Of each carrier's shards.
    tasks : list of Trace
        Each carrier's.

    Attributes
    ----------
    travel : Travel
    parts : list of Part
        The counters of all tasks.
    """

    def __init__(
        self, watch: Watch, carriers: list[Carrier], boxes: list[Boxes], tasks: list[Trace]
    ) -> None:
        self.travel = Travel()
        self.parts: list[Part] = []
        self._watch = watch
        self._carriers = carriers
        self._boxes = boxes
        self._tasks = tasks

    def fly(self, blocks: Iterator[Records]) -> Iterator[Block]:
        """Yield blocks of rays, (n,) of records.QUERY_RAY, in order, with what they have found."""
        flying: deque[tuple[Block, list[Errand]]] = deque()
        for rays in blocks:
            entries, task = carrier_entries(rays, self._boxes), self._tasks[0]
            block = Block(rays, entries, task.find, task.extras)
            flying.append((block, self._depart(block)))
            while len(flying) > AHEAD * len(self._carriers):
                yield self._land(*flying.popleft())
        while flying:
            yield self._land(*flying.popleft())

    def _depart(self, block: Block) -> list[Errand]:
        """Send rays to where they go next; return the tasks."""
        errands = []
        for carrier, which in block.departures():
            cargo = Cargo.of(block.rays[which])
            self.travel.sent(len(which), cargo)
            what = f"trace-{self.travel.legs}"
            workers = list(self._carriers[carrier].workers)
            errands += self._watch.begin(self._tasks[carrier], [cargo], what, workers)
        return errands

    def _land(self, block: Block, errands: list[Errand]) -> Block:
        """Wait until a block's rays have been everywhere."""
        while errands:
            for errand in errands:
                traced: Traced = self._watch.result(errand)
                records = traced.cargo.records(self._tasks[0].record)
                self.travel.came(len(records), traced.cargo)
                self.parts.append(traced.part)
                block.take(records)
            errands = self._depart(block)
        return block

    def stats(self, settings: dict[str, Any], objects: int) -> TravelStats:
        """Return the sum of all counters."""
        made = TravelStats(objects, 0, settings, travel=self.travel)
        if self.parts:
            whole = summed(self.parts)
            made = TravelStats(
                **{**vars(whole), "objects": objects, "scene_bytes": 0}, travel=self.travel
            )
        return made


def blocks_of(queue: Any, each: int = 1) -> Iterator[Records]:
    """Yield the rays of a queue, in blocks; `each` that belong together are in one."""
    most = each * max(1, BLOCK // each)
    while len(queue):
        yield queue.read(most).view(QUERY_RAY)
