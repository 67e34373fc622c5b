"""A sharded scene on a cluster: ray queries that go to where the shards are."""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from bfrt.cluster.asked import Asked
from bfrt.cluster.engine import client_of
from bfrt.cluster.watching import Watch
from bfrt.errors import SettingError
from bfrt.image.color_scale import ColorScale
from bfrt.image.pictures import Images
from bfrt.progress import Progress, Report, tell
from bfrt.queries.answers import Columns, Fields, Out, check_out, ordered, shapes_of
from bfrt.queries.casting import (
    COUNTS,
    HIT_FIELDS,
    LISTED,
    OCCLUDED,
    SPLITS,
    check_folder_of_hits,
    hit_columns,
    put_listed,
)
from bfrt.queries.containment import Containment
from bfrt.queries.extras import NO_EXTRAS, Extras
from bfrt.queries.given import Rays
from bfrt.queries.points import PointQuestion, RowPerPoint
from bfrt.queries.question import Answer, Question, warn_of_bad
from bfrt.queries.rays import RayQueue
from bfrt.queries.surfaces import SURFACE
from bfrt.records import RayKind
from bfrt.settings import scratch_folder
from bfrt.shards.store import ShardedStore, open_sharded
from bfrt.streams.spool import Spool
from bfrt.view import Views
from bfrt.wavefront import frame
from bfrt.wavefront.carriers import Carrier, ShardPlace, colors_of, shared_out, sights_of
from bfrt.wavefront.flight import Block, Flights, blocks_of
from bfrt.wavefront.frame import Wave
from bfrt.wavefront.routing import boxes_of
from bfrt.wavefront.site import Site
from bfrt.wavefront.tasks import Find, Trace

#: Hits of a listing that the client holds in memory.
HELD = 1 << 20


class Wanted(NamedTuple):
    """Says what a query finds.

    Attributes
    ----------
    find : Find
    kind : RayKind
        The kind of its rays.
    fields : Fields
        The arrays of the answer.
    extras : Extras
        What a nearest hit tells beside its surface.
    each : int
        Rays that a row of the answer is made of.
    """

    find: Find
    kind: RayKind
    fields: Fields
    extras: Extras = NO_EXTRAS
    each: int = 1


def nearest(extras: Extras) -> Wanted:
    """Return what finds the nearest hit of each ray, with what else is asked for."""
    return Wanted(Find.NEAREST, RayKind.EYE, {**HIT_FIELDS, **extras.fields}, extras)


ANY = Wanted(Find.ANY, RayKind.SHADOW, OCCLUDED)
COUNT = Wanted(Find.COUNT, RayKind.EYE, COUNTS)
ALL = Wanted(Find.ALL, RayKind.EYE, {**SPLITS, **LISTED})


class Journey(NamedTuple):
    """Holds the rays that travel for a question, and who is told of them.

    Attributes
    ----------
    wanted : Wanted
    rays : Rays
        Whose number is known.
    report : Report
    """

    wanted: Wanted
    rays: Rays
    report: Report


#: Fills the arrays of an answer from blocks of rays, as they land.
Fill = Callable[[Iterator[Block]], dict[str, NDArray[Any]]]


class Wavefront:
    """Answers queries about a sharded scene by the workers that have its shards.

    Parameters
    ----------
    client : distributed.Client
    path : Path
        The scene's file.

    Attributes
    ----------
    store : ShardedStore
        The scene, with no shard open here.
    carriers : list of Carrier
        Which worker answers for which shards.
    colors : tuple of ColorScale
        What colors say, of all shards.
    """

    def __init__(self, client: Any, path: Path) -> None:
        self.client = client_of(client)
        self.store: ShardedStore = open_sharded(path, ())
        self._path = os.path.abspath(path)  # noqa: PTH100  # links stay
        sights = sights_of(self.client, self._path)
        self.carriers: list[Carrier] = shared_out(self.store.manifest, sights)
        self.colors: tuple[ColorScale, ...] = colors_of(sights)

    def answer(
        self, wanted: Wanted, question: Question, asked: Asked, refine: str | None
    ) -> Answer:
        """Answer a question.

        Parameters
        ----------
        wanted : Wanted
        question : Question
        asked : Asked
            Settings of each worker.
        refine : str, optional
            None is what each worker's shards are made for.
        """
        rays = question.rays()
        if rays.known is None:
            raise SettingError(
                "origins: found blocks, expected arrays or files: a cluster needs their number"
            )
        journey = Journey(wanted, rays, question.report)
        return self._travelled(
            journey,
            asked,
            refine,
            lambda landed: answer_of(wanted, landed, rays, question.out, self._path),
        )

    def answer_points(
        self,
        query: RowPerPoint | Containment,
        question: PointQuestion,
        asked: Asked,
        refine: str | None,
    ) -> Answer:
        """Answer a question about points; parameters are those of `answer`."""

        def way(rows: RowPerPoint) -> Answer:
            given = rows.given(question)
            find = Find.ANY if rows.kind == RayKind.SHADOW else Find.COUNT
            wanted = Wanted(find, rows.kind, rows.fields, each=rows.each)
            journey = Journey(wanted, rows.rays(given, self.store), question.report)
            return self._travelled(
                journey,
                asked,
                refine,
                lambda landed: rows.filled(added_up(rows, find, landed), given, question.out),
            )

        return query.answered(way)

    def _travelled(self, journey: Journey, asked: Asked, refine: str | None, fill: Fill) -> Answer:
        """Return an answer, whose arrays are filled from the blocks of rays that land."""
        start = time.perf_counter()
        wanted, rays, report = journey
        queue = RayQueue(self.store, rays.blocks, wanted.kind)
        assert rays.known is not None
        with Watch(client_of(self.client), 0, None) as watch:
            flights = self._flights(watch, wanted, asked, refine)
            blocks = flights.fly(blocks_of(queue, wanted.each))
            answer = Answer(fill(told(blocks, rays.known, report)))
        stats = flights.stats({"refine": refine}, self.store.manifest.objects)
        stats.bad_rays = queue.bad
        stats.total.seconds = time.perf_counter() - start
        answer.stats = stats
        warn_of_bad(queue.bad)
        return answer

    def render(self, views: Views, asked: Asked, refine: str | None, report: Report) -> Images:
        """Render views.

        Parameters
        ----------
        views : Views
        asked : Asked
            Settings of each worker.
        refine : str, optional
            None is what each worker's shards are made for.
        report : Report
        """
        sites = [Site(place, asked, refine) for place in self._places()]
        wave = Wave(self.store, self.carriers, sites)
        return frame.render(
            wave, client_of(self.client), views, report, fresh_marks=asked.fresh_marks
        )

    def _places(self) -> list[ShardPlace]:
        """Return each carrier's shards."""
        return [ShardPlace(self._path, self.store.checksum, each.numbers) for each in self.carriers]

    def _flights(self, watch: Watch, wanted: Wanted, asked: Asked, refine: str | None) -> Flights:
        shards = self.store.manifest.shards
        boxes = [boxes_of(self.store, [shards[n] for n in each.numbers]) for each in self.carriers]
        find, extras = wanted.find, wanted.extras
        tasks = [Trace(place, asked, refine, find, extras) for place in self._places()]
        return Flights(watch, self.carriers, boxes, tasks)


def told(blocks: Iterator[Block], rays: int, report: Report) -> Iterator[Block]:
    """Yield blocks, and report after each; a report that returns False cancels."""
    done = 0
    for block in blocks:
        yield block
        done += len(block.rays)
        tell(report, Progress(1, done, rays))


def added_up(rows: RowPerPoint, find: Find, blocks: Iterator[Block]) -> Iterator[NDArray[np.int64]]:
    """Yield what the rays of each point add up to, as blocks of whole points land."""
    for block in blocks:
        if find is Find.ANY:
            values = np.where(block.found, np.uint32(0), rows.value(block.rays))
        else:
            block.rays["count"] = block.found
            values = rows.value(block.rays)
        yield values.reshape(-1, rows.each).sum(axis=1, dtype=np.int64)


def answer_of(
    wanted: Wanted, blocks: Iterator[Block], rays: Rays, out: Out | None, path: str
) -> dict[str, NDArray[Any]]:
    """Return the arrays of an answer, filled as blocks land."""
    assert rays.known is not None and rays.lead is not None
    if wanted.find is Find.ALL:
        return listed(blocks, rays.known, out, path)
    check_out(wanted.fields, rays.lead, out)
    with Columns(shapes_of(wanted.fields, rays.lead), out) as columns:
        for block in blocks:
            if wanted.find is Find.NEAREST:
                columns.put(hit_columns(block.found))
            else:
                columns.put({next(iter(wanted.fields)): block.found})
    return columns.arrays()


def listed(
    blocks: Iterator[Block], rays: int, out: Out | None, path: str
) -> dict[str, NDArray[Any]]:
    """Return all hits, in the order of their rays, then t, then id."""
    check_folder_of_hits(out)
    spool = Spool(SURFACE, HELD, scratch_folder(None, Path(path)))
    try:
        for block in blocks:
            spool.append(block.found)
        count = len(spool)
        return put_listed(ordered(spool, rays, HELD), count, rays, out)
    finally:
        spool.close()
