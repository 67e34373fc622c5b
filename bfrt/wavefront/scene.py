"""A sharded scene on a cluster: ray queries that go to where the shards are."""

from __future__ import annotations

import os
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

from numpy.typing import NDArray

from bfrt.cluster.asked import Asked
from bfrt.cluster.engine import client_of
from bfrt.cluster.watching import Watch
from bfrt.errors import SettingError
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
from bfrt.queries.given import Rays
from bfrt.queries.question import Answer, Question
from bfrt.queries.rays import RayQueue
from bfrt.queries.surfaces import SURFACE
from bfrt.records import RayKind
from bfrt.settings import scratch_folder
from bfrt.shards.store import ShardedStore, open_sharded
from bfrt.streams.spool import Spool
from bfrt.view import Views
from bfrt.wavefront import frame
from bfrt.wavefront.carriers import Carrier, ShardPlace, carriers_of
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
    """

    find: Find
    kind: RayKind
    fields: Fields


NEAREST = Wanted(Find.NEAREST, RayKind.EYE, HIT_FIELDS)
ANY = Wanted(Find.ANY, RayKind.SHADOW, OCCLUDED)
COUNT = Wanted(Find.COUNT, RayKind.EYE, COUNTS)
ALL = Wanted(Find.ALL, RayKind.EYE, {**SPLITS, **LISTED})


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
    """

    def __init__(self, client: Any, path: Path) -> None:
        self.client = client_of(client)
        self.store: ShardedStore = open_sharded(path, ())
        self._path = os.path.abspath(path)  # noqa: PTH100  # links stay
        self.carriers: list[Carrier] = carriers_of(self.client, self._path, self.store.manifest)

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
        start = time.perf_counter()
        rays = question.rays()
        if rays.known is None:
            raise SettingError(
                "origins: found blocks, expected arrays or files: a cluster needs their number"
            )
        queue = RayQueue(self.store, rays.blocks, wanted.kind)
        with Watch(client_of(self.client), 0, None) as watch:
            flights = self._flights(watch, wanted.find, asked, refine)
            landed = told(flights.fly(blocks_of(queue)), rays.known, question.report)
            arrays = answer_of(wanted, landed, rays, question.out, self._path)
        answer = Answer(arrays)
        stats = flights.stats({"refine": refine}, self.store.manifest.objects)
        stats.bad_rays = queue.bad
        stats.total.seconds = time.perf_counter() - start
        answer.stats = stats
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

    def _flights(self, watch: Watch, find: Find, asked: Asked, refine: str | None) -> Flights:
        shards = self.store.manifest.shards
        boxes = [boxes_of(self.store, [shards[n] for n in each.numbers]) for each in self.carriers]
        tasks = [Trace(place, asked, refine, find) for place in self._places()]
        return Flights(watch, self.carriers, boxes, tasks)


def told(blocks: Iterator[Block], rays: int, report: Report) -> Iterator[Block]:
    """Yield blocks, and report after each; a report that returns False cancels."""
    done = 0
    for block in blocks:
        yield block
        done += len(block.rays)
        tell(report, Progress(1, done, rays))


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
