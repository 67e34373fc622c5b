"""``cast_rays`` and its kin: what rays meet in a scene larger than memory.

::

    rays ─► queue ─► Tracer: nearest hit, any hit, or all ─► spool
                                                              │ sorted by object
                                            surfaces: normals, uv
                                                              │ sorted by ray
                                                           arrays, or files
"""

from __future__ import annotations

import logging
import os
import time
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, closing
from itertools import chain
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from bfrt.budget import Capacities
from bfrt.errors import SettingError
from bfrt.ids import index_of, stream_of
from bfrt.phases.all_hits import AllHits
from bfrt.phases.hit_order import by_object, hits_of, picked
from bfrt.progress import Progress, Report, tell
from bfrt.queries._rays import surfaces
from bfrt.queries.answers import (
    Columns,
    Fields,
    Out,
    check_folder,
    check_out,
    ordered,
    rows,
    split_ends,
)
from bfrt.queries.rays import AskedRays, Block, Given, rays_of
from bfrt.records import HIT, NO_HIT, QUERY_RAY, QUEUED_BYTES, RayKind
from bfrt.rendering import stats_of
from bfrt.scan.scan import StreamScan
from bfrt.scan.scans import GroupScans
from bfrt.settings import Settings
from bfrt.stats import Counters, Stats, peak_rss
from bfrt.store.store import Stream
from bfrt.streams.spool import Spool
from bfrt.tracer import Outcome, Tracer
from bfrt.workers import Workers

log = logging.getLogger(__name__)

#: What a miss has for ``geometry_ids`` and ``primitive_ids``.
MISS = -1

#: A hit as it is told of.
ANSWER = np.dtype(
    [
        ("number", "<u8"),
        ("t", "<f8"),
        ("key", "<u8"),
        ("normal", "<f4", 3),
        ("uv", "<f4", 2),
    ]
)
NUMBERED = np.dtype([("number", "<u8")])
COUNTED = np.dtype([("number", "<u8"), ("count", "<u4")])

HIT_FIELDS: Fields = {
    "t_hit": (np.float64, ()),
    "geometry_ids": (np.int32, ()),
    "primitive_ids": (np.int64, ()),
    "primitive_normals": (np.float32, (3,)),
    "primitive_uvs": (np.float32, (2,)),
}

OCCLUDED: Fields = {"occluded": (np.bool_, ())}
COUNTS: Fields = {"counts": (np.int64, ())}

SPLITS: Fields = {"ray_splits": (np.int64, ())}


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
    """

    origins: Given
    directions: Given | None
    t_min: ArrayLike
    t_max: ArrayLike
    out: Out | None
    report: Report

    def rays(self) -> tuple[Iterator[Block], int | None]:
        """Return the blocks of rays, and how many rays they are where that is known."""
        return rays_of(self.origins, self.directions, self.t_min, self.t_max)


#: Gives a tracer for some settings while a question is worked on.
Sessions = Callable[[Settings], AbstractContextManager[Tracer]]


class Asking:
    """Works on one question.

    Parameters
    ----------
    tracer : Tracer
    blocks : iterator of Block
        The rays.
    known : int, optional
        Number of rays, if known.
    kind : RayKind
        EYE for nearest hits, SHADOW for any.
    report : Report
    """

    def __init__(
        self,
        tracer: Tracer,
        blocks: Iterator[Block],
        known: int | None,
        kind: RayKind,
        report: Report,
    ) -> None:
        self.tracer = tracer
        self.queue = AskedRays(tracer.store, blocks, kind)
        self.plan = tracer.capacities
        self.stats = stats_of(tracer)
        self._known = known
        self._report = report
        self._start = time.perf_counter()

    def trace(self, take: Callable[[NDArray[Any]], None], crossings: AllHits | None = None) -> None:
        """Take all rays through the scene; `take` gets them as they are complete."""
        self.tracer.begin(self.stats)
        with self.stats.depth(1) as counters:
            outcome = Outcome(Forward(take), None, crossings)
            self.tracer.trace(self.queue, outcome, counters, self._tell)
            counters.rays.eye = self.queue.taken

    def _tell(self, done: int) -> None:
        total = self.queue.taken if self._known is None else self._known
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
        if bad:
            log.warning("%d rays were NaN, infinite or of no length, and hit nothing", bad)
        return answer


def nearest(sessions: Sessions, question: Question, settings: Settings) -> Answer:
    """Find the nearest hit of each ray: `bfrt.cast_rays`."""
    blocks, known = question.rays()
    check_out(HIT_FIELDS, known, question.out)
    with sessions(settings) as tracer:
        asking = Asking(tracer, blocks, known, RayKind.EYE, question.report)
        room = fitting(asking.plan, known)
        with Answers(asking, ANSWER, room.queue) as answers:
            with closing(asking.spool(HIT, room.hits)) as hits:
                asking.trace(lambda some: hits.append(some[some["id"] != NO_HIT].view(HIT)))
                _resolve(asking, hits, answers.append)
            missed = np.zeros(1, ANSWER)
            missed["t"], missed["key"] = np.inf, NO_HIT
            with Columns(HIT_FIELDS, asking.queue.taken, question.out) as columns:
                for block in rows(answers.ordered(asking.queue.taken), asking.queue.taken, missed):
                    columns.put(_hit_columns(block))
        return asking.answer(columns.arrays())


def any_hit(sessions: Sessions, question: Question, settings: Settings) -> Answer:
    """Find whether each ray hits anything: `bfrt.occluded`."""
    blocks, known = question.rays()
    check_out(OCCLUDED, known, question.out)
    with sessions(settings) as tracer:
        asking = Asking(tracer, blocks, known, RayKind.SHADOW, question.report)
        with Answers(asking, NUMBERED, fitting(asking.plan, known).queue) as answers:
            # What something stops does not come out.
            asking.trace(lambda some: answers.append(_fields(some, NUMBERED)))
            stopped = np.array([(NO_HIT,)], NUMBERED)
            with Columns(OCCLUDED, asking.queue.taken, question.out) as columns:
                for block in rows(answers.ordered(asking.queue.taken), asking.queue.taken, stopped):
                    columns.put({"occluded": block["number"] == NO_HIT})
        return asking.answer(columns.arrays())


def count_hits(sessions: Sessions, question: Question, settings: Settings) -> Answer:
    """Count all hits of each ray: `bfrt.count_intersections`."""
    blocks, known = question.rays()
    check_out(COUNTS, known, question.out)
    with sessions(settings) as tracer:
        asking = Asking(tracer, blocks, known, RayKind.EYE, question.report)
        with Answers(asking, COUNTED, fitting(asking.plan, known).queue) as answers:
            asking.trace(
                lambda some: answers.append(_fields(some[some["count"] > 0], COUNTED)), AllHits()
            )
            none = np.zeros(1, COUNTED)
            with Columns(COUNTS, asking.queue.taken, question.out) as columns:
                for block in rows(answers.ordered(asking.queue.taken), asking.queue.taken, none):
                    columns.put({"counts": block["count"]})
        return asking.answer(columns.arrays())


def list_hits(sessions: Sessions, question: Question, settings: Settings) -> Answer:
    """Find all hits of each ray: `bfrt.list_intersections`."""
    blocks, known = question.rays()
    folder = _folder_of(question.out)
    with sessions(settings) as tracer:
        asking = Asking(tracer, blocks, known, RayKind.EYE, question.report)
        with Answers(asking, ANSWER, asking.plan.queue) as answers:
            with closing(asking.spool(HIT, asking.plan.hits)) as hits:
                asking.trace(lambda some: None, AllHits(lambda asked: hits.append(asked.view(HIT))))
                _resolve(asking, hits, answers.append)
            arrays = _listed(answers, asking.queue.taken, folder)
        return asking.answer(arrays)


def _listed(answers: Answers, rays: int, folder: Out | None) -> dict[str, NDArray[Any]]:
    """Put all hits in the order of their rays, and say where each ray's end."""
    fields = {"ray_ids": (np.int64, ()), **HIT_FIELDS}
    with (
        Columns(fields, len(answers), folder) as columns,
        Columns(SPLITS, rays + 1, folder) as splits,
    ):
        splits.put({"ray_splits": np.zeros(1, np.int64)})
        hits_before = rays_before = 0
        for block in chain(answers.ordered(rays), [np.empty(0, ANSWER)]):
            numbers = block["number"].astype(np.int64)
            columns.put({"ray_ids": numbers, **_hit_columns(block)})
            end = int(numbers[-1]) + 1 if len(numbers) else rays
            for ends in split_ends(numbers, rays_before, end):
                splits.put({"ray_splits": hits_before + ends})
            hits_before, rays_before = hits_before + len(numbers), end
    return {**splits.arrays(), **columns.arrays()}


def fitting(plan: Capacities, rays: int | None) -> Capacities:
    """Return the capacities without memory that `rays` rays, with a hit each, cannot fill."""
    return plan if rays is None else plan.for_hits(rays)


def _folder_of(out: Out | None) -> Out | None:
    """Return the folder for an answer; refuse arrays, since the number of hits is not yet known."""
    if out is None:
        return None
    if isinstance(out, (str, os.PathLike)):
        check_folder(Path(os.fsdecode(out)))
        return out
    raise SettingError("out: found arrays, expected a folder: how many hits there are is not known")


class Forward:
    """Takes rays as they are complete, in place of a spool."""

    def __init__(self, take: Callable[[NDArray[Any]], None]) -> None:
        self._take = take

    def append(self, records: NDArray[Any]) -> None:
        self._take(records.view(QUERY_RAY))


class Answers:
    """Answers as they come, to be read in the order of rays.

    Parameters
    ----------
    asking : Asking
    dtype : numpy.dtype
        The type of an answer's record.
    queue : int
        Rays whose memory they may take.
    """

    def __init__(self, asking: Asking, dtype: np.dtype[Any], queue: int) -> None:
        self._room = max(1024, queue * QUEUED_BYTES // dtype.itemsize)
        self._spool = asking.spool(dtype, self._room)
        self.append = self._spool.append

    def __len__(self) -> int:
        return len(self._spool)

    def ordered(self, rays: int) -> Iterator[NDArray[Any]]:
        return ordered(self._spool, rays, self._room)

    def __enter__(self) -> Answers:
        return self

    def __exit__(self, *_: object) -> None:
        self._spool.close()


class Surfaces:
    """Finds normals and uv of hits; only the objects that are hit are read.

    Parameters
    ----------
    hits : (n,) records.QUERY_RAY
        Ascending by id.
    workers : Workers

    Attributes
    ----------
    normals, uvs : ndarray of float32, shape (n, 3), (n, 2)
    """

    def __init__(self, hits: NDArray[Any], workers: Workers) -> None:
        self.normals = np.empty((len(hits), 3), np.float32)
        self.uvs = np.empty((len(hits), 2), np.float32)
        self._hits = hits
        self._ids = np.ascontiguousarray(hits["id"])
        self._workers = workers

    def find(self, scans: GroupScans) -> None:
        """Find normals and uv of the hits on a group's objects."""
        for stream in scans.streams:
            part = hits_of(self._ids, stream)
            if part.start < part.stop:
                self._find(scans, stream, part)

    def _find(self, scans: GroupScans, stream: Stream, part: slice) -> None:
        source, starts = picked(scans, stream, self._ids[part])
        starts += part.start

        def resolve(_: int, chunk: tuple[StreamScan, slice]) -> None:
            scan, some = chunk
            own = slice(starts[some.start], starts[some.stop])
            surfaces(scan, self._hits[own], self.normals[own], self.uvs[own])

        self._workers.drain(source, resolve)


def _resolve(asking: Asking, hits: Spool, append: Callable[[NDArray[Any]], None]) -> None:
    """Find normals and uv of hits, object by object."""
    counters = Counters()
    with counters.phases.shading.timed():
        groups = asking.tracer.scans
        # Half of them, for what is found takes memory too.
        for records, begins in by_object(hits, groups, max(1, asking.plan.hits // 2)):
            some = records.view(QUERY_RAY)
            found = np.empty(len(some), ANSWER)
            faces = Surfaces(some, asking.tracer.workers)
            for scans in groups:
                faces.find(scans)
                counters.sweep(0, scans, begins)
                counters.phases.shading.swept(scans)
            found["number"], found["key"] = some["number"], some["id"]
            found["t"] = np.ldexp(some["t"] + some["moved"], -some["power"])
            found["normal"], found["uv"] = faces.normals, faces.uvs
            append(found)
        counters.phases.shading.spooled(hits)
    asking.stats.total.add(counters)


def _fields(records: NDArray[Any], dtype: np.dtype[Any]) -> NDArray[Any]:
    """Return the fields of records that `dtype` has."""
    made = np.empty(len(records), dtype)
    for name in dtype.names or ():
        made[name] = records[name]
    return made


def _hit_columns(block: NDArray[Any]) -> dict[str, NDArray[Any]]:
    ids = block["key"]
    missed = ids == NO_HIT
    stream, index = stream_of(ids), index_of(ids)
    return {
        "t_hit": block["t"],
        "geometry_ids": np.where(missed, MISS, stream.astype(np.int32)),
        "primitive_ids": np.where(missed, MISS, index.astype(np.int64)),
        "primitive_normals": block["normal"],
        "primitive_uvs": block["uv"],
    }
