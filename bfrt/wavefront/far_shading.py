"""Hits of a picture, each shaded by the worker that has its object."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterator, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bfrt.cluster.counters import Part
from bfrt.ids import group_of, stream_of
from bfrt.image.film import Film
from bfrt.image.film_parts import SUMS, FilmPart, add_part, seen_by
from bfrt.records import QUEUED
from bfrt.shards.manifest import Manifest
from bfrt.streams.bucket_sort import gathered
from bfrt.streams.spool import Spool
from bfrt.wavefront.cargo import BLOCK, Cargo
from bfrt.wavefront.carriers import Carrier
from bfrt.wavefront.frame_tasks import HitShading, Shaded
from bfrt.wavefront.travel import ShadingTravel
from bfrt.wavefront.window import AHEAD, Window

Records = NDArray[Any]

#: Blocks of rays that a block of hits may send on.
SENT_ON = 2


def hits_at_once(shadow_rays: int) -> int:
    """Return the hits of a block: fewer where each sends many shadow rays."""
    return max(1, min(BLOCK, SENT_ON * BLOCK // (shadow_rays + 2)))


class Owners:
    """Knows which carrier has an object.

    Parameters
    ----------
    manifest : Manifest
    carriers : sequence of Carrier
    """

    def __init__(self, manifest: Manifest, carriers: Sequence[Carrier]) -> None:
        groups = sum(shard.groups for shard in manifest.shards)
        self._of_group = np.full(groups, -1, np.int64)
        for number, carrier in enumerate(carriers):
            for shard in (manifest.shards[n] for n in carrier.numbers):
                self._of_group[shard.group : shard.group + shard.groups] = number

    def of(self, ids: NDArray[np.uint64]) -> NDArray[np.int64]:
        """Return the carrier of each object."""
        owners: NDArray[np.int64] = self._of_group[group_of(stream_of(ids)).astype(np.int64)]
        return owners


class FarShading:
    """Has the hits of a depth shaded.

    Parameters
    ----------
    window : Window
    owners : Owners
    tasks : list of HitShading
        Each carrier's.
    room : int
        Hits that are in memory at once.
    count : callable
        Takes the counters of each task.
    """

    def __init__(
        self,
        window: Window,
        owners: Owners,
        tasks: list[HitShading],
        room: int,
        count: Callable[[Part], None],
    ) -> None:
        self._window = window
        self._owners = owners
        self._tasks = tasks
        self._room = room
        self._count = count

    def shade(
        self,
        hits: Spool,
        film: Film,
        following: Spool,
        travel: ShadingTravel,
        tell: Callable[[], None],
    ) -> None:
        """Shade all hits; light goes to the film, rays that go on to `following`.

        A carrier gets hits in the order of their objects, as many at once as memory holds.

        Parameters
        ----------
        tell : callable
            Called after each task.
        """
        while len(hits):
            load = gathered(hits, self._room)
            waiting = self._blocks(load)
            while self._window.busy or any(waiting):
                self._send(waiting, load, travel)
                done = self._window.take()
                self._take(done.result, film, following, travel)
                tell()

    def _blocks(self, load: Records) -> list[deque[NDArray[np.int64]]]:
        """Return the places of each carrier's hits, by their objects, in blocks."""
        owners = self._owners.of(load["id"])
        order = np.lexsort((load["id"], owners))
        ends = np.searchsorted(owners[order], np.arange(len(self._tasks) + 1))
        return [
            deque(
                _cut(
                    order[ends[c] : ends[c + 1]],
                    hits_at_once(task.viewpoints.illuminations[0].shadow_rays),
                )
            )
            for c, task in enumerate(self._tasks)
        ]

    def _send(
        self, waiting: list[deque[NDArray[np.int64]]], load: Records, travel: ShadingTravel
    ) -> None:
        for carrier, blocks in enumerate(waiting):
            while blocks and self._window.under_way(carrier) < AHEAD:
                some = load[blocks.popleft()]
                cargo = Cargo.of(some)
                travel.hits += len(some)
                travel.depart(cargo)
                self._window.send(carrier, self._tasks[carrier], cargo)

    def _take(self, shaded: Shaded, film: Film, following: Spool, travel: ShadingTravel) -> None:
        self._count(shaded.part)
        aovs = self._tasks[0].aovs
        rays = shaded.rays.records(QUEUED)
        part = FilmPart(shaded.sums.records(SUMS), shaded.seen.records(seen_by(aovs)))
        add_part(film, part)
        following.append(rays)
        travel.rays += len(rays)
        travel.elements += len(part.sums)
        travel.bytes_of_rays += len(shaded.rays)
        travel.bytes_of_film += len(shaded.sums) + len(shaded.seen)


def _cut(places: NDArray[np.int64], most: int) -> Iterator[NDArray[np.int64]]:
    for first in range(0, len(places), most):
        yield places[first : first + most]
