"""Questions about points: some rays from each, of which one row of the answer is made.

::

    points ─► rays, so many each ─► Tracer ─► (point, sum) ─► sorted by point ─► added up ─► rows
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from bfrt.checkpoint.checkpoint import Checkpoint
from bfrt.errors import SettingError
from bfrt.phases.all_hits import AllHits
from bfrt.phases.traversal import ADMITTED
from bfrt.progress import Report
from bfrt.queries.answers import Columns, Fields, Out, check_out, shapes_of, sums
from bfrt.queries.direct import is_resident
from bfrt.queries.given import RAYS_AT_ONCE, Block, Held, Points, Rays, Stored, rows_of
from bfrt.queries.question import Answer, Answers, Query, Sessions
from bfrt.records import RayKind
from bfrt.settings import Settings
from bfrt.stats import Counters
from bfrt.store.store import Store
from bfrt.tree.casting import TreeCaster
from bfrt.tree_tracer import TreeTracer

#: What some of the rays of a point add up to.
SUMMED = np.dtype([("number", "<u8"), ("count", "<u4")])

Records = NDArray[Any]

#: Makes the rays of some points, the first of which has a number: origins and directions.
Look = Callable[[int, Records, Records | None], tuple[Records, Records]]


class PointQuestion(NamedTuple):
    """Holds the points that a caller asks about, and where the answer goes.

    Attributes
    ----------
    points : Points
        As for `bfrt.visibility`.
    normals : Points, optional
    out : mapping of arrays, or path-like, optional
    report : Report
    checkpoint : Checkpoint, optional
    first : int
        The number of the first point.
    """

    points: Points
    normals: Points | None
    out: Out | None
    report: Report
    checkpoint: Checkpoint | None = None
    first: int = 0


class GivenPoints(NamedTuple):
    """Holds points, to be read once.

    Attributes
    ----------
    points : Held or Stored
    normals : Held or Stored, optional
    first : int
        The number of the first point.
    """

    points: Held | Stored
    normals: Held | Stored | None
    first: int


class RowPerPoint(NamedTuple):
    """Says what a query does whose answer has a row for each point.

    Attributes
    ----------
    kind : RayKind
        SHADOW for any hit, EYE for all of them.
    each : int
        Rays of a point.
    distance : float
        Where they end.
    look : callable
        Gives the function that makes them, for a store.
    value : callable
        Gives what rays that are complete count for, uint32: rays of SHADOW are complete if nothing
        stops them.
    fields : Fields
        The one array of the answer.
    row : callable
        Gives the answer's rows for sums of values.
    """

    kind: RayKind
    each: int
    distance: float
    look: Callable[[Store], Look]
    value: Callable[[Records], NDArray[np.uint32]]
    fields: Fields
    row: Callable[[NDArray[np.int64]], Records]

    def answer(self, sessions: Sessions, question: PointQuestion, settings: Settings) -> Answer:
        """Answer a question."""
        given = self.given(question)
        with sessions(settings) as tracer:
            query = Query(tracer, self.rays(given, tracer.store), self.kind, question)
            direct = self.kind == RayKind.SHADOW and question.checkpoint is None
            go = self._cast if direct and is_resident(tracer) else self._trace
            return query.answer(self.filled(go(query), given, question.out))

    def answered(self, way: Callable[[RowPerPoint], Answer]) -> Answer:
        """Return the answer of one who has rays traced in another way."""
        return way(self)

    def given(self, question: PointQuestion) -> GivenPoints:
        """Return the points of a question.

        Raises
        ------
        SettingError
            If they have other shapes or dtypes; if the answer cannot be put where it is to go.
        """
        points, normals = _given(question)
        check_out(self.fields, points.lead, question.out)
        return GivenPoints(points, normals, question.first)

    def filled(
        self, added: Iterator[NDArray[np.int64]], given: GivenPoints, out: Out | None
    ) -> dict[str, Records]:
        """Return the arrays of the answer, filled by the sums of all points, in order."""
        with Columns(shapes_of(self.fields, given.points.lead), out) as columns:
            for some in added:
                columns.put({key: self.row(some) for key in self.fields})
        return columns.arrays()

    def rays(self, given: GivenPoints, store: Store) -> Rays:
        """Return the rays of points, whose last axis is that of one point's."""
        (points, normals, number), look = given, self.look(store)
        some = max(1, RAYS_AT_ONCE // self.each)
        begin, end = (np.broadcast_to(t, some * self.each) for t in (0.0, self.distance))

        def blocks() -> Iterator[Block]:
            first = number
            beside = _nothing() if normals is None else normals.blocks(some)
            for p, n in zip(points.blocks(some), beside, strict=normals is not None):
                origins, directions = look(first, p, n)
                yield origins, directions, begin[: len(origins)], end[: len(origins)]
                first += len(p)

        return Rays(blocks(), (*points.lead, self.each))

    def _trace(self, query: Query) -> Iterator[NDArray[np.int64]]:
        """Yield the sums of all points, in order, when all rays have been traced."""
        with Answers(query, SUMMED, query.capacities.queue) as answers:
            crossings = None if self.kind == RayKind.SHADOW else AllHits()
            query.trace(lambda rays: answers.append(self._summed(rays)), answers.spool, crossings)
            yield from sums(answers.ordered(), query.rays // self.each)

    def _summed(self, rays: Records) -> Records:
        """Return what complete rays add up to, a record for each of their points."""
        values = self.value(rays)
        counted = values > 0
        points = rays["number"][counted] // np.uint64(self.each)
        numbers, which = np.unique(points, return_inverse=True)
        made = np.empty(len(numbers), SUMMED)
        made["number"], made["count"] = numbers, np.bincount(which, values[counted], len(numbers))
        return made

    def _cast(self, query: Query) -> Iterator[NDArray[np.int64]]:
        """Yield the sums of points as their rays come back from treelets in memory."""
        tracer = query.tracer
        assert isinstance(tracer, TreeTracer)
        tracer.begin(query.stats)
        with query.stats.depth(1) as counters:
            while len(query.queue):
                query.tell(query.queue.taken)
                with counters.phases.intersection.timed():
                    values = self._cast_some(query, tracer, counters)
                yield values.reshape(-1, self.each).sum(axis=1, dtype=np.int64)
            query.tell(query.queue.taken)
            counters.rays.eye = query.rays

    def _cast_some(
        self, query: Query, tracer: TreeTracer, counters: Counters
    ) -> NDArray[np.uint32]:
        """Return the values of the next rays, those of whole points."""
        number, block = query.queue.taken, query.queue.take(max(ADMITTED, self.each))
        values = np.empty(len(block[0]), np.uint32)

        def work(worker: int, first: int, last: int) -> None:
            rays = query.queue.records(block, first, last, number + first)
            values[first:last] = self._open(tracer.casters[worker], rays)

        tracer.cast(work, len(values), counters)
        return values

    def _open(self, caster: TreeCaster, rays: Records) -> NDArray[np.uint32]:
        """Return the values of rays, 0 of those that something stops."""
        stopped = np.empty(len(rays), np.uint8)
        caster.occluded(rays, stopped)
        return np.where(stopped, np.uint32(0), self.value(rays))


def is_bad(rays: Records) -> NDArray[np.bool_]:
    """Tell which rays are NaN, infinite or of no length: their end is behind their begin."""
    bad: NDArray[np.bool_] = rays["t"] < 0.0
    return bad


def _given(question: PointQuestion) -> tuple[Held | Stored, Held | Stored | None]:
    """Return the points and the normals, rows of three.

    Raises
    ------
    SettingError
        If they have other shapes or dtypes.
    """
    points = rows_of("points", question.points)
    if question.normals is None:
        return points, None
    normals = rows_of("normals", question.normals)
    if normals.lead == () and points.lead:
        normals = normals.spread(points.lead)
    if normals.lead != points.lead:
        raise SettingError(
            f"normals: found shape {normals.shape}, expected {points.shape}, as points have, or "
            "(3,) for all"
        )
    return points, normals


def _nothing() -> Iterator[None]:
    while True:
        yield None
