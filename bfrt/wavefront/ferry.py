"""Rays of a picture on their way from carrier to carrier.

::

    queue ─► blocks, each with its route ─► outboxes, one a carrier ─► tasks ─┐
                        ▲                                                     │
                        └──── nearer hits; which rays go on, and where ◄──────┘

Rays of many blocks that go to one carrier travel together, in blocks of a fixed size. A carrier
that has nothing to do gets what there is. The nearest hit is the least (t, id): it does not matter
which ray comes when.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterator
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from bfrt.cluster.counters import Part
from bfrt.records import QUERY_RAY
from bfrt.wavefront.cargo import BLOCK, Cargo
from bfrt.wavefront.frame_tasks import MET, Meeting
from bfrt.wavefront.routing import NOWHERE, Boxes, Route
from bfrt.wavefront.tasks import Traced
from bfrt.wavefront.travel import Travel
from bfrt.wavefront.window import AHEAD, Window

Records = NDArray[Any]
Which = NDArray[np.int64]


class Block:
    """Holds rays until all of them have been everywhere.

    Parameters
    ----------
    rays : (n,) records.HIT
        With an end each, which becomes their nearest hit.
    boxes : list of (m, 2, 3) float64
        Of each carrier's shards.

    Attributes
    ----------
    left : int
        Rays that are not through.
    """

    def __init__(self, rays: Records, boxes: list[Boxes]) -> None:
        self.rays = rays
        self.left = len(rays)
        self._route = Route(rays, boxes)

    def go_on(self, which: Which) -> Iterator[tuple[int, Which]]:
        """Yield carriers, and those of some rays that go to each next; the others are through."""
        carriers = self._route.next(which, self.rays["t"][which])
        self.left -= int((carriers == NOWHERE).sum())
        for carrier in np.unique(carriers[carriers != NOWHERE]).tolist():
            yield carrier, which[carriers == carrier]


class Share(NamedTuple):
    """Names some rays of a block."""

    block: Block
    which: Which


class Outbox:
    """Queues the rays that go to one carrier."""

    def __init__(self) -> None:
        self._shares: deque[Share] = deque()
        self._count = 0

    def __len__(self) -> int:
        """Return the number of rays."""
        return self._count

    def put(self, share: Share) -> None:
        self._shares.append(share)
        self._count += len(share.which)

    def take(self, most: int) -> list[Share]:
        """Return up to `most` rays, those that have waited longest."""
        taken = []
        while self._shares and most:
            block, which = self._shares.popleft()
            taken.append(Share(block, which[:most]))
            if len(which) > most:
                self._shares.appendleft(Share(block, which[most:]))
            self._count -= len(taken[-1].which)
            most -= len(taken[-1].which)
        return taken


def packed(shares: list[Share]) -> Cargo:
    """Return rays as they travel: with their places in place of what they are for."""
    rays: Records = np.concatenate([share.block.rays[share.which] for share in shares])
    rays = rays.view(QUERY_RAY)  # the kind is in the same place
    rays["number"] = np.arange(len(rays))
    rays["moved"], rays["count"], rays["power"] = 0.0, 0, 0
    return Cargo.of(rays)


class Ferry:
    """Takes rays to all carriers that they have to go to.

    Parameters
    ----------
    window : Window
    tasks : list of Meeting
        Each carrier's.
    boxes : list of (m, 2, 3) float64
        Of each carrier's shards.
    held : int
        Blocks that the client holds at once.
    count : callable
        Takes the counters of each task.
    """

    def __init__(
        self,
        window: Window,
        tasks: list[Meeting],
        boxes: list[Boxes],
        held: int,
        count: Callable[[Part], None],
    ) -> None:
        self._window = window
        self._tasks = tasks
        self._boxes = boxes
        self._held = held
        self._count = count
        self._outboxes = [Outbox() for _ in tasks]

    def cross(
        self, blocks: Iterator[Records], travel: Travel, tell: Callable[[int], None]
    ) -> Iterator[Records]:
        """Yield blocks of rays, (n,) of records.HIT, with their nearest hits, in any order.

        Parameters
        ----------
        blocks : iterator of (n,) records.HIT
            Rays that have met nothing yet.
        travel : Travel
            Gets what travels.
        tell : callable
            Called with the number of rays that are through, after each task.
        """
        inside: list[Block] = []
        through = 0
        tell(through)
        while True:
            while len(inside) < self._held and (rays := next(blocks, None)) is not None:
                inside.append(Block(rays, self._boxes))
                self._send_on(Share(inside[-1], np.arange(len(rays))))
            self._depart(travel)
            landed = [block for block in inside if not block.left]
            inside = [block for block in inside if block.left]
            for block in landed:
                through += len(block.rays)
                yield block.rays
            if not landed and not self._window.busy:
                return
            if not landed:
                self._arrive(travel)
            tell(through + sum(len(block.rays) - block.left for block in inside))

    def _send_on(self, share: Share) -> None:
        for carrier, which in share.block.go_on(share.which):
            self._outboxes[carrier].put(Share(share.block, which))

    def _depart(self, travel: Travel) -> None:
        """Send full blocks, and to carriers that have nothing to do what waits for them."""
        for carrier, outbox in enumerate(self._outboxes):
            while len(outbox) >= BLOCK and self._window.under_way(carrier) < AHEAD:
                self._send(carrier, outbox.take(BLOCK), travel)
            if len(outbox) and not self._window.under_way(carrier):
                self._send(carrier, outbox.take(BLOCK), travel)

    def _send(self, carrier: int, shares: list[Share], travel: Travel) -> None:
        cargo = packed(shares)
        travel.sent(sum(len(share.which) for share in shares), cargo)
        self._window.send(carrier, self._tasks[carrier], cargo, shares)

    def _arrive(self, travel: Travel) -> None:
        """Take what a task has found, and send its rays on."""
        done = self._window.take()
        traced: Traced = done.result
        self._count(traced.part)
        met = traced.cargo.records(MET)
        travel.came(len(met), traced.cargo)
        begin = 0
        for share in done.note:
            end = begin + len(share.which)
            own = met[np.searchsorted(met["place"], begin) : np.searchsorted(met["place"], end)]
            at = share.which[own["place"] - begin]
            share.block.rays["t"][at], share.block.rays["id"][at] = own["t"], own["id"]
            self._send_on(share)
            begin = end
