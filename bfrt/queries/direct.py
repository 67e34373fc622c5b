"""Rays through treelets that are all in memory: from the caller's arrays to those of the answer.

Nothing is queued or sorted: a worker makes some rays into records, takes each down the tree, and
fills its row.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from numpy.typing import NDArray

from bfrt.phases.traversal import ADMITTED
from bfrt.queries.answers import Columns, Fields, Out, shapes_of
from bfrt.queries.question import Query
from bfrt.stats import Counters
from bfrt.tracer import Tracer
from bfrt.tree.casting import TreeCaster
from bfrt.tree_tracer import TreeTracer

#: Has a caster fill rows of an answer, by their keys, for records of rays.
Cast = Callable[[TreeCaster, NDArray[Any], dict[str, NDArray[Any]]], None]


def is_resident(tracer: Tracer) -> bool:
    """Tell whether all treelets of a scene may be in memory."""
    return isinstance(tracer, TreeTracer) and tracer.resident


def cast_all(query: Query, cast: Cast, fields: Fields, out: Out | None) -> dict[str, NDArray[Any]]:
    """Fill an answer of a row for each ray, whose number is known."""
    tracer = query.tracer
    assert isinstance(tracer, TreeTracer)
    assert query.known is not None
    tracer.begin(query.stats)
    shapes = shapes_of(fields, query.lead)
    with query.stats.depth(1) as counters, Columns(shapes, out) as columns:
        with counters.phases.intersection.timed():
            while len(query.queue):
                query.tell(query.queue.taken)
                columns.put(_cast_some(query, tracer, cast, columns, counters))
            query.tell(query.queue.taken)
        counters.rays.eye = query.rays
    return columns.arrays()


def _cast_some(
    query: Query, tracer: TreeTracer, cast: Cast, columns: Columns, counters: Counters
) -> dict[str, NDArray[Any]]:
    """Return the next rows of the answer."""
    number = query.queue.taken
    block = query.queue.take(ADMITTED)
    made = columns.room(len(block[0]))

    def work(worker: int, first: int, last: int) -> None:
        rays = query.queue.records(block, first, last, number + first)
        some = {key: values[first:last] for key, values in made.items()}
        cast(tracer.casters[worker], rays, some)

    tracer.cast(work, len(block[0]), counters)
    return made
