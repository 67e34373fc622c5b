"""A session on a scene: what is costly, made once, for many queues of rays.

::

    Tracer ─┬─ GridTracer     the paper's: rays in the voxels of a grid, objects stream past
            └─ TreeTracer     rays in treelets, which stream, or are in memory

    with tracer_of(...) as tracer:
        tracer.trace(queue, outcome, counters, tell)      as often as there are queues
"""

from __future__ import annotations

import os
from abc import ABC, abstractmethod
from collections.abc import Callable
from typing import NamedTuple, TypeVar

from bfrt.budget import Capacities
from bfrt.checkpoint.state import Facts, SavedState, StateWriter
from bfrt.image.film import Film
from bfrt.phases.all_hits import AllHits
from bfrt.phases.flight import BegunAgain, Pool
from bfrt.phases.traversal import Queue, Sink
from bfrt.records import PATH_BYTES, RAY_BYTES
from bfrt.scan.scans import GroupScans
from bfrt.settings import Settings
from bfrt.stats import Counters, Stats
from bfrt.store.model import Vector
from bfrt.store.store import Store
from bfrt.workers import Workers

#: Called with the rays that are finished so far.
Tell = Callable[[int], None]

Own = TypeVar("Own", bound="Tracer")


class Outcome(NamedTuple):
    """Says where the results of rays go.

    Attributes
    ----------
    hits : Sink
        Takes intersections; without a film all rays, whether they have met something or not.
    film : Film, optional
        Takes the light of shadow rays that met nothing, and the background of others.
    crossings : AllHits, optional
        Takes all that rays meet, each of which then goes on to its end.
    background : tuple of 3 float
        The color of rays that meet nothing, where there is a film.
    """

    hits: Sink
    film: Film | None = None
    crossings: AllHits | None = None
    background: Vector = (0.0, 0.0, 0.0)


class Tracer(ABC):
    """Finds what queues of rays meet in a scene.

    Parameters
    ----------
    store : Store
    settings : Settings
    capacities : Capacities
        The capacities that the memory budget gives.

    Attributes
    ----------
    workers : Workers
    scratch : Path
        Folder for what memory does not hold.
    prepared : Counters
        The time and traffic of making all this ready.
    """

    def __init__(self, store: Store, settings: Settings, capacities: Capacities) -> None:
        self.store = store
        self.settings = settings
        self.capacities = capacities
        self.scratch = settings.scratch_beside(store.path)
        self.prepared = Counters()
        self.workers = Workers(capacities.threads)
        self._process = os.getpid()

    @property
    @abstractmethod
    def scans(self) -> list[GroupScans]:
        """Return the objects of each group."""

    @property
    @abstractmethod
    def bad(self) -> int:
        """Return the number of rays so far that were NaN or had no direction."""

    @abstractmethod
    def trace(self, queue: Queue, outcome: Outcome, counters: Counters, tell: Tell) -> None:
        """Find what every ray in `queue` meets; `tell` gets the rays finished so far."""

    @property
    @abstractmethod
    def pool(self) -> Pool:
        """Return the rays in flight."""

    @abstractmethod
    def where(self, group: int) -> str:
        """Tell what the sentinels of rays in flight through a group are of."""

    @abstractmethod
    def save(self, writer: StateWriter) -> Facts:
        """Save where `trace` is; only between two passes, when `tell` is called.

        Returns
        -------
        dict
            The group that rays go through, what their sentinels are of, the next pass's candidates.
        """

    @property
    def state_bytes(self) -> int:
        """Return about as many bytes as `save` writes."""
        return self.pool.active * (RAY_BYTES + PATH_BYTES)

    def begun_again(self, saved: SavedState, facts: Facts) -> Queue | None:
        """Return the saved rays in flight, if they cannot go on where they were.

        They have to be traced before the rest of the queue that they came from.
        """
        again = BegunAgain(saved)
        same = facts["where"] == self.where(facts["group"]) and len(again) <= self.pool.capacity
        return None if same or not len(again) else again

    @abstractmethod
    def restore(self, saved: SavedState, facts: Facts, *, rays: bool) -> None:
        """Have the next `trace` begin where another was.

        Parameters
        ----------
        saved : SavedState
        facts : dict
            What `save` returned.
        rays : bool
            Whether rays in flight go on where they were; otherwise they have begun again.
        """

    def begin(self, stats: Stats) -> None:
        """Add the work of preparing to a record of counters; a second one gets none of it."""
        stats.total.add(self.prepared)
        self.prepared = Counters()

    def close(self) -> None:
        """End the threads, close the files, and free the disk."""
        self.workers.close()

    def serves(self, settings: Settings) -> bool:
        """Tell whether it works with these settings here: a forked process lacks its threads."""
        return self.settings == settings and self._process == os.getpid()

    def __enter__(self: Own) -> Own:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()
