"""``cast_rays`` and its kin: what rays meet in a scene larger than memory.

::

    rays ─► queue ─► Tracer: nearest hit, any hit, or all ─► spool
                                                              │ sorted by object
                                            surfaces: normals, uv
                                                              │ sorted by ray
                                                           arrays, or files
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from contextlib import closing
from functools import partial
from itertools import chain
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from bfrt.errors import SettingError
from bfrt.ids import index_of, stream_of
from bfrt.phases.all_hits import AllHits
from bfrt.queries.answers import (
    Columns,
    Fields,
    Out,
    check_out,
    pieces,
    rows,
    shapes_of,
    split_ends,
)
from bfrt.queries.direct import Cast, cast_all, is_resident
from bfrt.queries.extras import EXTRA_FIELDS, NO_EXTRAS, Extras
from bfrt.queries.question import Answer, Answers, Query, Question, Sessions
from bfrt.queries.surfaces import SURFACE, surfaces_of
from bfrt.records import HIT, NO_HIT, RayKind
from bfrt.settings import Settings
from bfrt.stats import Counters
from bfrt.streams.spool import Spool

#: What a miss has for ``geometry_ids`` and ``primitive_ids``.
MISS = -1

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
LISTED: Fields = {"ray_ids": (np.int64, ()), **HIT_FIELDS}

Block = NDArray[Any]


class RowPerRay(NamedTuple):
    """Says what a query does whose answer has a row for each ray.

    Attributes
    ----------
    kind : RayKind
        The kind of its rays.
    fields : Fields
        The arrays of the answer.
    absent : ndarray, shape (1,)
        The record of a ray that is not among those found.
    find : callable
        Traces the rays of a query, and appends records, one a ray at the most, to answers.
    columns : callable
        Gives the answer's rows for a block of records.
    cast : callable, optional
        Has a caster of treelets in memory fill the answer's rows for records of rays.
    """

    kind: RayKind
    fields: Fields
    absent: Block
    find: Callable[[Query, Answers], None]
    columns: Callable[[Block], dict[str, Block]]
    cast: Cast | None = None

    def answer(self, sessions: Sessions, question: Question, settings: Settings) -> Answer:
        """Answer a question."""
        rays = question.rays()
        check_out(self.fields, rays.lead, question.out)
        with sessions(settings) as tracer:
            query = Query(tracer, rays, self.kind, question)
            at_once = rays.known is not None and question.checkpoint is None
            if self.cast is not None and at_once and is_resident(tracer):
                return query.answer(cast_all(query, self.cast, self.fields, question.out))
            with Answers(query, self.absent.dtype, query.capacities.queue) as answers:
                self.find(query, answers)
                check_out(self.fields, query.lead, question.out)
                shapes = shapes_of(self.fields, query.lead)
                with Columns(shapes, question.out) as columns:
                    for block in rows(answers.ordered(), query.rays, self.absent):
                        columns.put(self.columns(block))
            return query.answer(columns.arrays())


def _nearest(query: Query, answers: Answers, extras: Extras) -> None:
    with closing(query.spool(HIT, query.capacities.hits)) as hits:
        query.trace(lambda rays: hits.append(rays[rays["id"] != NO_HIT].view(HIT)), hits)
        _resolve(query, hits, query.capacities.hits, answers, extras)


def _any_hit(query: Query, answers: Answers) -> None:
    # What something stops does not come out.
    query.trace(lambda rays: answers.append(_fields(rays, NUMBERED)), answers.spool)


def _count(query: Query, answers: Answers) -> None:
    query.trace(
        lambda rays: answers.append(_fields(rays[rays["count"] > 0], COUNTED)),
        answers.spool,
        AllHits(),
    )


def _resolve(
    query: Query, hits: Spool, room: int, answers: Answers, extras: Extras = NO_EXTRAS
) -> None:
    """Find normals and uv of hits, and what else is asked for."""
    counters = Counters()
    with counters.phases.shading.timed():
        for found in surfaces_of(hits, query.tracer, room, counters, extras):
            answers.append(found)
    query.stats.total.add(counters)


def _fields(records: Block, dtype: np.dtype[Any]) -> Block:
    """Return the fields of records that `dtype` has."""
    made = np.empty(len(records), dtype)
    for name in dtype.names or ():
        made[name] = records[name]
    return made


def hit_columns(block: Block) -> dict[str, Block]:
    """Return the columns of an answer for hits, (n,) of SURFACE; NO_HIT is the key of a miss."""
    ids = block["key"]
    missed = ids == NO_HIT
    stream, index = stream_of(ids), index_of(ids)
    return {
        "t_hit": block["t"],
        "geometry_ids": np.where(missed, MISS, stream.astype(np.int32)),
        "primitive_ids": np.where(missed, MISS, index.astype(np.int64)),
        "primitive_normals": block["normal"],
        "primitive_uvs": block["uv"],
        **{key: block[key] for key in EXTRA_FIELDS if key in (block.dtype.names or ())},
    }


def record_of_miss(extras: Extras = NO_EXTRAS) -> Block:
    """Return the record of a miss, (1,) of SURFACE with the fields of `extras`."""
    record = np.zeros(1, SURFACE)
    record["t"], record["key"] = np.inf, NO_HIT
    return extras.missed(record)


def nearest(extras: Extras = NO_EXTRAS) -> RowPerRay:
    """Return `bfrt.cast_rays`: the nearest hit of each ray, with what else is asked for."""
    return RowPerRay(
        RayKind.EYE,
        {**HIT_FIELDS, **extras.fields},
        record_of_miss(extras),
        partial(_nearest, extras=extras),
        hit_columns,
        lambda caster, rays, columns: caster.nearest(rays, columns, extras.side),
    )


#: `bfrt.occluded`: whether each ray hits anything.
ANY_HIT = RowPerRay(
    RayKind.SHADOW,
    OCCLUDED,
    np.array([(NO_HIT,)], NUMBERED),
    _any_hit,
    lambda block: {"occluded": block["number"] == NO_HIT},
    lambda caster, rays, columns: caster.occluded(rays, columns["occluded"].view(np.uint8)),
)

#: `bfrt.count_intersections`: the number of each ray's hits.
COUNT = RowPerRay(
    RayKind.EYE, COUNTS, np.zeros(1, COUNTED), _count, lambda block: {"counts": block["count"]}
)


class RowPerHit:
    """Answers `bfrt.list_intersections`: all hits of each ray, a row each."""

    def answer(self, sessions: Sessions, question: Question, settings: Settings) -> Answer:
        """Answer a question."""
        rays = question.rays()
        check_folder_of_hits(question.out)
        with sessions(settings) as tracer:
            query = Query(tracer, rays, RayKind.EYE, question)
            room = tracer.capacities  # a ray may have many hits
            with Answers(query, SURFACE, room.queue) as answers:
                with closing(query.spool(HIT, room.hits)) as hits:
                    crossings = AllHits(lambda found: hits.append(found.view(HIT)))
                    query.trace(lambda rays: None, hits, crossings)
                    _resolve(query, hits, room.hits, answers)
                hits_found = len(answers)
                return query.answer(
                    put_listed(answers.ordered(), hits_found, query.rays, question.out)
                )


LIST = RowPerHit()


def check_folder_of_hits(out: Out | None) -> None:
    """Refuse what is no folder for an answer whose number of rows is not yet known."""
    if isinstance(out, (str, os.PathLike)):
        check_out({**SPLITS, **LISTED}, None, out)
    elif out is not None:
        raise SettingError(
            "out: found arrays, expected a folder: how many hits there are is not known"
        )


def put_listed(
    hits: Iterator[Block], count: int, rays: int, folder: Out | None
) -> dict[str, Block]:
    """Put all hits into an answer, and say where each ray's end.

    Parameters
    ----------
    hits : iterator of (n,) SURFACE
        In the order of their rays.
    count : int
        Their number.
    rays : int
    folder : path-like, optional
        Where the answer goes.
    """
    shapes = {**shapes_of(SPLITS, (rays + 1,)), **shapes_of(LISTED, (count,))}
    with Columns(shapes, folder) as columns:
        columns.put({"ray_splits": np.zeros(1, np.int64)})
        hits_before = rays_before = 0
        for block in chain(pieces(hits), [np.empty(0, SURFACE)]):
            numbers = block["number"].astype(np.int64)
            columns.put({"ray_ids": numbers, **hit_columns(block)})
            end = int(numbers[-1]) if len(numbers) else rays  # the last one's may go on
            for ends in split_ends(numbers, rays_before, end):
                columns.put({"ray_splits": hits_before + ends})
            hits_before, rays_before = hits_before + len(numbers), end
    return columns.arrays()
