"""Ray queries of dask arrays: a task for each block of rays, and dask arrays of the answer.

::

    origins ──┐
    directions┼─► a task a block ─┬─► t_hit            each block's own rows
    t_min ... ┘    (all its keys) ├─► primitive_ids
    marks, made once ──┘          └─► counters ─► their sum
"""

from __future__ import annotations

import functools
import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from bfrt.cluster.asked import Asked
from bfrt.cluster.counters import ClusterStats, Part, summed
from bfrt.cluster.engine import dask_array
from bfrt.cluster.lazy_answer import LazyAnswer, answer_of
from bfrt.cluster.lazy_counters import LazyCounters, counters_of
from bfrt.cluster.lazy_rays import LazyRays, lazy_rays
from bfrt.cluster.place import Place
from bfrt.cluster.reports import TaskReport
from bfrt.cluster.work import Prepared, Work, ready
from bfrt.cluster.worker import this_worker
from bfrt.errors import SettingError
from bfrt.queries import casting
from bfrt.queries.answers import Fields
from bfrt.queries.casting import RowPerHit, RowPerRay
from bfrt.queries.extras import NO_EXTRAS, Extras
from bfrt.queries.question import Question
from bfrt.settings import TREE
from bfrt.store.store import Store

#: The queries by their names, but `cast_rays`.
QUERIES: dict[str, RowPerRay | RowPerHit] = {
    "occluded": casting.ANY_HIT,
    "count_intersections": casting.COUNT,
    "list_intersections": casting.LIST,
}

#: The key of a block's counters, beside those of its arrays.
COUNTERS = "counters"

SPLITS = "ray_splits"


class Local(NamedTuple):
    """Holds what a caller asks for that only queries of arrays in memory have.

    Attributes
    ----------
    out, progress, checkpoint
        As for `bfrt.cast_rays`.
    """

    out: object
    progress: object
    checkpoint: object

    def check(self) -> None:
        """Refuse them.

        Raises
        ------
        SettingError
            For the first that is asked for.
        """
        instead = {
            "out": "None: dask.array.store and to_zarr write dask arrays",
            "progress": "False: dask.diagnostics.ProgressBar and distributed.progress show it",
            "checkpoint": "None: dask.persist keeps what is computed",
        }
        for name, expected in instead.items():
            value = getattr(self, name)
            if value is not None and value is not False:
                raise SettingError(f"{name}: found one with dask arrays, expected {expected}")


@dataclass(frozen=True)
class BlockQuery:
    """Asks about the rays of one block, as a task.

    Attributes
    ----------
    work : Work
    name : str
        The query.
    extras : Extras
        What `cast_rays` tells beside what it always tells.
    """

    work: Work
    name: str
    extras: Extras = NO_EXTRAS

    @property
    def query(self) -> RowPerRay | RowPerHit:
        """Return the query."""
        return casting.nearest(self.extras) if self.name == "cast_rays" else QUERIES[self.name]

    def __call__(
        self, origins: Any, directions: Any, t_min: Any, t_max: Any, first: Any, prepared: Any
    ) -> dict[str, Any]:
        """Return the arrays of the answer, with the counters beside them.

        Parameters
        ----------
        origins, directions : (n, 3) or (h, w, 3) ndarray, in nested lists of one
            As Dask hands over blocks of which the rows are whole.
        t_min, t_max : float, or (n,) or (h, w) ndarray
            In lists likewise.
        first : (1,) ndarray, or None
            The number of the block's first ray, where rays are numbered.
        prepared : Prepared, or None
            What marks were made for, where there are any.
        """
        o, d, near, far = map(unpacked, (origins, directions, t_min, t_max))
        question = Question(o, d, near, far, None, TaskReport())
        work = self.work if prepared is None else self.work.with_budget(prepared)
        with work.begun() as (session, settings):
            answer = self.query.answer(session.tracer, question, settings)
        if first is not None:
            answer["ray_ids"] += first[0]
        return {**answer, COUNTERS: (this_worker().name, answer.stats)}


def ask_in_blocks(
    name: str,
    store: Store,
    given: tuple[Any, Any, Any, Any],
    asked: Asked,
    local: Local,
    extras: Extras = NO_EXTRAS,
) -> LazyAnswer:
    """Return what a query of dask arrays will answer.

    Parameters
    ----------
    name : str
        The query: "cast_rays", or one of `QUERIES`.
    store : Store
    given : tuple
        Origins, directions, t_min and t_max; some of them are dask arrays.
    asked : Asked
    local : Local
    extras : Extras
        What `cast_rays` tells beside what it always tells.

    Raises
    ------
    SettingError
        If rays have other shapes or dtypes, or something is asked for that is not to be had.
    """
    local.check()
    rays, work = lazy_rays(*given), Work(Place.of(store), asked)
    listed = name == "list_intersections"
    prepared = prepared_for(work)
    block = BlockQuery(work, name, extras)
    blocks = _blocks(block, rays, rays.firsts() if listed else None, prepared)
    if listed:
        arrays = {SPLITS: _splits(blocks, rays), **_listed(blocks)}
    else:
        query = block.query
        assert isinstance(query, RowPerRay)
        arrays = columns_of(blocks, query.fields, rays.lead)
    return answer_of(arrays, summed_counters(blocks, prepared))


def prepared_for(work: Work) -> Any:
    """Return the task that all blocks wait for: it makes marks where there are none.

    A tree has no marks, and waits for nothing: None.
    """
    from dask import delayed

    if work.asked.refine == TREE:
        return None

    return delayed(functools.partial(ready, work), pure=True)()


def _blocks(query: BlockQuery, rays: LazyRays, firsts: Any, prepared: Any) -> Any:
    """Return the answers of all blocks, each a dict, as the blocks of a dask array."""
    axes = "ijk"[: 1 + len(rays.lead)]
    pairs: list[Any] = [rays.origins, f"{axes}x", rays.directions, f"{axes}x"]
    for column in (rays.t_min, rays.t_max, firsts):
        pairs += [column, axes[: column.ndim] if hasattr(column, "chunks") else None]
    return dask_array().blockwise(
        query, "i", *pairs, prepared, None, dtype=object, meta=np.empty(0, object),
        token=f"bfrt-{query.name}", align_arrays=False,
    )  # fmt: skip


def columns_of(blocks: Any, fields: Fields, lead: tuple[int, ...]) -> dict[str, Any]:
    """Return the arrays of an answer of a row for each ray, of that shape behind the first axis."""
    return {key: _column(blocks, key, dtype, (*lead, *row)) for key, (dtype, row) in fields.items()}


def _listed(blocks: Any) -> dict[str, Any]:
    """Return the arrays of an answer of a row for each hit: nobody knows how many there are."""
    unknown = {"adjust_chunks": {"i": math.nan}}
    fields = casting.LISTED.items()
    return {key: _column(blocks, key, dtype, row, unknown) for key, (dtype, row) in fields}


def _column(
    blocks: Any, key: str, dtype: Any, row: tuple[int, ...], sizes: Mapping[str, Any] | None = None
) -> Any:
    axes = "ijkl"[: 1 + len(row)]
    return dask_array().blockwise(
        column_of, axes, blocks, "i", key, None, new_axes=dict(zip("jkl", row, strict=False)),
        dtype=dtype, meta=np.empty((0,) * len(axes), dtype), token=f"bfrt-{key}", **(sizes or {}),
    )  # fmt: skip


def _splits(blocks: Any, rays: LazyRays) -> Any:
    """Return where the hits of each ray begin, through all blocks."""
    da = dask_array()
    counts = da.blockwise(
        counts_of, "i", blocks, "i", adjust_chunks={"i": rays.chunks},
        dtype=np.int64, meta=np.empty(0, np.int64), token="bfrt-counts",
    )  # fmt: skip
    return da.concatenate([da.zeros(1, dtype=np.int64, chunks=1), da.cumsum(counts, axis=0)])


def unpacked(block: Any) -> Any:
    """Return what nested lists of one have."""
    while isinstance(block, list):
        (block,) = block
    return block


def summed_counters(blocks: Any, prepared: Any) -> LazyCounters:
    """Return the sum of the counters of all blocks, for Dask to compute."""
    parts = dask_array().blockwise(
        part_of, "i", blocks, "i",
        dtype=object, meta=np.empty(0, object), token="bfrt-part",
    )  # fmt: skip
    key = parts.name.replace("part", "counters")
    task = (all_counters, parts.__dask_keys__(), None if prepared is None else prepared.key)
    return counters_of({key: task}, key, [parts] if prepared is None else [parts, prepared])


def column_of(answer: Mapping[str, Any], key: str) -> NDArray[Any]:
    """Return one array of a block's answer."""
    column: NDArray[Any] = answer[key]
    return column


def counts_of(answer: Mapping[str, Any]) -> NDArray[np.int64]:
    """Return the number of hits of each ray of a block."""
    counts: NDArray[np.int64] = np.diff(answer[SPLITS])
    return counts


def part_of(answer: Mapping[str, Any]) -> Part:
    """Return the counters of a block."""
    part: Part = answer[COUNTERS]
    return part


def all_counters(parts: list[Part], prepared: Prepared | None) -> ClusterStats:
    """Return the sum of the counters of all blocks, and of preparing."""
    return summed(parts if prepared is None else [prepared.part, *parts])
