"""One question: its rays, its way through the scene, its counters."""

from __future__ import annotations

import logging
import time
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager
from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from bfrt.checkpoint.checkpoint import Checkpoint
from bfrt.checkpoint.soundness import Sound
from bfrt.checkpoint.state import Facts, SavedState, StateWriter
from bfrt.phases.all_hits import AllHits
from bfrt.phases.flight import PATHS
from bfrt.phases.traversal import Queue
from bfrt.progress import Progress, Report, tell
from bfrt.queries.answers import Out, ordered
from bfrt.queries.given import Given, Lead, Rays, rays_of
from bfrt.queries.rays import RayQueue
from bfrt.records import HIT, QUERY_PATH, QUERY_RAY, QUEUED_BYTES, RayKind
from bfrt.rendering import stats_of
from bfrt.settings import Settings
from bfrt.stats import Counters, Stats, peak_rss
from bfrt.streams.spool import Spool
from bfrt.tracer import Outcome, Tracer

log = logging.getLogger(__name__)

#: The fewest answers that are worth holding in memory.
FEWEST_HELD = 1024

#: The file of what has come of rays.
HELD = "held"

#: Takes records of rays.
Take = Callable[[NDArray[Any]], object]

#: Rays, their ends, and where the answer goes.
RaysGiven = tuple[Given, Given | None, ArrayLike, ArrayLike, Out | None]


class Answer(dict[str, NDArray[Any]]):
    """Maps names to the arrays of a query's answer.

    It is a dict. Each query's docstring lists its keys, such as ``t_hit``, with shapes and dtypes;
    arrays that went to a folder are memory maps.

    Attributes
    ----------
    stats : bfrt.stats.Stats
        The counters of the query. ``stats.bad_rays`` counts rays that are NaN, infinite or of no
        length; they hit nothing.
    """

    stats: Stats


class Question(NamedTuple):
    """Holds the rays that a caller asks about, and where the answer goes.

    Attributes
    ----------
    origins, directions, t_min, t_max
        As for `bfrt.cast_rays`.
    out : mapping of arrays, or path-like, optional
        Where the answer goes.
    report : Report
        Called after each pass.
    checkpoint : Checkpoint, optional
        Keeps the state of the query, which goes on from the one that it has found.
    """

    origins: Given
    directions: Given | None
    t_min: ArrayLike
    t_max: ArrayLike
    out: Out | None
    report: Report
    checkpoint: Checkpoint | None = None

    def rays(self) -> Rays:
        """Return the rays, to be read once.

        Raises
        ------
        SettingError
            If they have other shapes or dtypes than rays have.
        """
        return rays_of(self.origins, self.directions, self.t_min, self.t_max)


#: Gives a tracer for some settings while a question is worked on.
Sessions = Callable[[Settings], AbstractContextManager[Tracer]]


class Asking(Protocol):
    """Tells of a question what its way through the scene needs."""

    @property
    def report(self) -> Report:
        """Return what is called after each pass."""
        ...

    @property
    def checkpoint(self) -> Checkpoint | None:
        """Return what keeps the state, where anything does."""
        ...


class Query:
    """Takes the rays of a question through the scene.

    Parameters
    ----------
    tracer : Tracer
    rays : Rays
    kind : RayKind
        EYE for nearest hits, SHADOW for any.
    question : Asking

    Attributes
    ----------
    queue : RayQueue
        The rays that are still to be taken.
    known : int, optional
        The number of rays, where it is known.
    capacities : Capacities
        Memory for rays and hits: no more than the rays fill, with one hit each, where their number
        is known.
    """

    def __init__(self, tracer: Tracer, rays: Rays, kind: RayKind, question: Asking) -> None:
        self.tracer = tracer
        whole = tracer.capacities
        self.capacities = whole if rays.known is None else whole.for_hits(rays.known)
        self.stats = stats_of(tracer)
        self._checkpoint = question.checkpoint
        kept = self._checkpoint is not None
        self.queue = RayQueue(tracer.store, rays.blocks, kind, checked=kept)
        self.known = rays.known
        self._lead = rays.lead
        self._report = question.report
        self._start = time.perf_counter()

    @property
    def rays(self) -> int:
        """Return the number of rays so far: all, once they are traced."""
        return self.queue.taken

    @property
    def lead(self) -> Lead:
        """Return the leading shape of the rays: that of the answer, once they are traced."""
        return (self.rays,) if self._lead is None else self._lead

    def trace(self, take: Take, held: Spool, crossings: AllHits | None = None) -> None:
        """Take all rays through the scene.

        Parameters
        ----------
        take : callable
            Gets the rays, of QUERY_RAY, as they are complete.
        held : Spool
            What has come of them, which is a part of the query's state.
        crossings : AllHits, optional
            Gets all hits of each ray.
        """
        self.tracer.begin(self.stats)
        outcome = Outcome(Complete(take), None, crossings)
        began, before = time.perf_counter(), 0
        with self.stats.depth(1) as counters:
            if self._checkpoint is not None and self._checkpoint.found is not None:
                saved = self._checkpoint.found
                before = go_on(self, saved, outcome, counters, held)
                self._checkpoint.went_on(f"{before:,} rays, of {self.rays:,} begun")

            def save(writer: StateWriter, done: int) -> Facts:
                stats = self.stats.kept(1, counters, started=self._start, began=began)
                return {**save_query(self, writer, held), "done": done, "stats": stats}

            def between_passes(done: int) -> None:
                if self._checkpoint is None:
                    self.tell(done)
                    return
                size = self.tracer.state_bytes + len(held) * held.dtype.itemsize
                self._checkpoint.between_passes(
                    lambda writer: save(writer, before + done),
                    size,
                    lambda: self.tell(before + done),
                )

            self.tracer.trace(self.queue, outcome, counters, between_passes)
            counters.rays.eye = self.rays

    def tell(self, done: int) -> None:
        """Tell who asked how many rays are finished."""
        total = self.rays if self.known is None else self.known
        tell(self._report, Progress(1, done, total))

    def spool(self, dtype: np.dtype[Any], room: int) -> Spool:
        """Return a spool that holds a number of records in memory."""
        return Spool(dtype, room, self.tracer.scratch)

    def answer(self, arrays: dict[str, NDArray[Any]]) -> Answer:
        """Return the answer, with the counters."""
        bad = self.queue.bad
        answer = Answer(arrays)
        answer.stats = self.stats
        self.stats.total.seconds += time.perf_counter() - self._start
        self.stats.bad_rays = bad
        self.stats.peak_rss_bytes = peak_rss()
        warn_of_bad(bad)
        return answer


def warn_of_bad(rays: int) -> None:
    """Tell how many rays hit nothing since they are none, if there are such."""
    if rays:
        log.warning("%d rays were NaN, infinite or of no length, and hit nothing", rays)


def save_query(query: Query, writer: StateWriter, held: Spool) -> Facts:
    """Save a query between two passes: the rays taken, those in flight, what has come of others."""
    writer.put(HELD, held.waiting())
    return {"rays": query.queue.facts(), "tracer": query.tracer.save(writer)}


def go_on(
    query: Query, saved: SavedState, outcome: Outcome, counters: Counters, held: Spool
) -> int:
    """Bring a query back to where it was; return how many of its rays are finished.

    Rays for which there is no way back are traced anew. Of those whose hits are all wanted, what
    was found before is forgotten.
    """
    facts, tracer = saved.facts, query.tracer
    saved.sound = Sound(tracer.store, rays=facts["rays"]["taken"])
    query.queue.go_on(saved.folder.parent, facts["rays"])
    query.stats.go_on(facts["stats"])
    done: int = facts["done"]
    again = tracer.begun_again(saved, facts["tracer"])
    blocks = saved.blocks(HELD, held.dtype)
    if again is not None and outcome.crossings is not None:
        again = Anew(again)
        if held.dtype == HIT:
            numbers = np.concatenate([path["number"] for path in saved.blocks(PATHS, QUERY_PATH)])
            blocks = without(blocks, np.sort(numbers))
    held.restore(blocks)
    if again is not None:
        rays = len(again)
        tracer.trace(again, outcome, counters, lambda _: query.tell(done))
        done += rays
    tracer.restore(saved, facts["tracer"], rays=again is None)
    return done


def without(blocks: Iterator[NDArray[Any]], numbers: NDArray[np.uint64]) -> Iterator[NDArray[Any]]:
    """Yield hits, of records.HIT, but for those of the rays with some numbers, ascending."""
    for hits in blocks:
        own = hits.view(QUERY_RAY)["number"]
        at = np.minimum(np.searchsorted(numbers, own), len(numbers) - 1)
        yield hits[numbers[at] != own]


class Anew:
    """Queues rays whose hits are counted from nothing.

    Parameters
    ----------
    rays : Queue
        Of records.HIT, with paths of QUERY_PATH.
    """

    def __init__(self, rays: Queue) -> None:
        self._rays = rays

    def __len__(self) -> int:
        return len(self._rays)

    def read(self, most: int) -> NDArray[Any]:
        """Return the next rays, (n,) of records.HIT with n <= most."""
        some = self._rays.read(most)
        some.view(QUERY_RAY)["count"] = 0
        return some


class Complete:
    """Hands rays on as they are complete, in place of a spool."""

    def __init__(self, take: Take) -> None:
        self._take = take

    def append(self, records: NDArray[Any]) -> None:
        self._take(records.view(QUERY_RAY))


class Answers:
    """Holds answers as they come, to be read in the order of rays.

    Parameters
    ----------
    query : Query
    dtype : numpy.dtype
        The type of an answer's record.
    rays : int
        Rays whose memory they may take.

    Attributes
    ----------
    spool : Spool
        The answers so far.
    """

    def __init__(self, query: Query, dtype: np.dtype[Any], rays: int) -> None:
        self._room = max(FEWEST_HELD, rays * QUEUED_BYTES // dtype.itemsize)
        self.spool = query.spool(dtype, self._room)
        self._query = query
        self.append = self.spool.append

    def __len__(self) -> int:
        return len(self.spool)

    def ordered(self) -> Iterator[NDArray[Any]]:
        """Yield them by ascending ray numbers, once all rays are traced."""
        return ordered(self.spool, self._query.rays, self._room)

    def __enter__(self) -> Answers:
        return self

    def __exit__(self, *_: object) -> None:
        self.spool.close()
