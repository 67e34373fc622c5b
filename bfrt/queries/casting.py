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
from contextlib import closing
from itertools import chain
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from bfrt.budget import Capacities
from bfrt.errors import Cancelled, SettingError
from bfrt.phases.crossings import Crossings
from bfrt.phases.picking import by_object, each_hit
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
from bfrt.queries.rays import AskedRays, Given, rays_of
from bfrt.records import ASKED, HIT, INDEX_BITS, NO_HIT, QUEUED_BYTES, RayKind
from bfrt.rendering import REFINEMENTS, plan_of, reporting, scratch_folder
from bfrt.scene.store import Store, open_store
from bfrt.scene.sweep import Sweep
from bfrt.scheduler import Progress, Tracer
from bfrt.stats import Counters, Stats, peak_rss
from bfrt.streams.spool import Spool
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
    """Arrays by their keys.

    Attributes
    ----------
    stats : Stats
        The counters; ``stats.bad_rays`` are NaN, infinite or of no length, and hit nothing.
    """

    stats: Stats


class _Query(NamedTuple):
    """One question as it is worked on."""

    store: Store
    plan: Capacities
    scratch: Path
    refine: str
    stats: Stats
    fresh_marks: bool


def cast_rays(
    scene: Store | str | os.PathLike[str],
    origins: Given,
    directions: Given | None = None,
    t_min: ArrayLike = 0.0,
    t_max: ArrayLike = np.inf,
    *,
    out: Out | None = None,
    progress: bool | Callable[[Progress], object] = False,
    **settings: Any,
) -> Answer:
    """Find the nearest hit of each ray.

    Parameters
    ----------
    scene : Store or path-like
        An open store, or where one is.
    origins, directions : (n, 3) array_like of float32 or float64, or path-like of an .npy file
        World coordinates; directions of any length but zero. Memory maps and files may be larger
        than memory. Without directions, `origins` is an iterable of blocks, pairs of such arrays.
    t_min, t_max : float or (n,) array_like
        Hits count in (t_min, t_max), in lengths of the direction.
    out : mapping of arrays, or path-like, optional
        Arrays to fill, by the keys of the answer; or a folder that gets a file ``KEY.npy`` of
        each, and the answer is memory maps of these.
    progress : bool or callable
        As for `render`.
    **settings
        ``memory``, ``threads``, ``refine``, ``fresh_marks``, ``grid``, ``max_grid`` and
        ``scratch``, as for `render`. Arrays that you give, and get, are no part of the budget.

    Returns
    -------
    Answer
        ``t_hit`` (n,) float64, inf for a miss; ``geometry_ids`` (n,) int32, group times 5 plus
        kind, and ``primitive_ids`` (n,) int64, the object's place among its kind, both -1 for a
        miss; ``primitive_normals`` (n, 3) float32, unit and geometric, 0 for a miss;
        ``primitive_uvs`` (n, 2) float32, barycentric in triangles and patches, else 0.

    Raises
    ------
    SettingError
        For rays of other shapes or dtypes, and settings that cannot be honoured.
    BudgetError, StoreError, StreamError, DiskFullError, Cancelled
        As `render`.

    Notes
    -----
    A ray with a t_min begins at ``origin + t_min * direction``, computed in float64. Of hits at
    one t the object of the least id counts. The answer is the same, bit for bit, whatever the
    memory, the threads and the refinement.
    """
    blocks, known = rays_of(origins, directions, t_min, t_max)
    query = _ask(scene, known, known, **settings)
    check_out(HIT_FIELDS, known, out)
    queue = AskedRays(query.store, blocks, RayKind.EYE)
    with Answers(query, ANSWER) as answers:
        with closing(Spool(HIT, query.plan.hits, query.scratch)) as hits:
            sink = Forward(lambda some: hits.append(some[some["id"] != NO_HIT].view(HIT)))
            _trace(
                query,
                queue,
                sink,
                known,
                progress,
                then=lambda tracer: _resolve(tracer, query, hits, answers.append),
            )
        missed = np.zeros(1, ANSWER)
        missed["t"], missed["key"] = np.inf, NO_HIT
        with Columns(HIT_FIELDS, queue.taken, out) as columns:
            for block in rows(answers.ordered(queue.taken), queue.taken, missed):
                columns.put(_hit_columns(block))
    return _answer(query, columns.arrays(), queue)


def occluded(
    scene: Store | str | os.PathLike[str],
    origins: Given,
    directions: Given | None = None,
    t_min: ArrayLike = 0.0,
    t_max: ArrayLike = np.inf,
    *,
    out: Out | None = None,
    progress: bool | Callable[[Progress], object] = False,
    **settings: Any,
) -> Answer:
    """Find whether each ray hits anything in (t_min, t_max); the parameters are `cast_rays`'.

    From a to b: directions ``b - a``, t_max 1, or a little less where b is on a surface.

    Returns
    -------
    Answer
        ``occluded`` (n,) bool.
    """
    blocks, known = rays_of(origins, directions, t_min, t_max)
    query = _ask(scene, known, known, **settings)
    check_out(OCCLUDED, known, out)
    with Answers(query, NUMBERED) as answers:
        queue = AskedRays(query.store, blocks, RayKind.SHADOW)
        # What something stops does not come out.
        sink = Forward(lambda some: answers.append(_fields(some, NUMBERED)))
        _trace(query, queue, sink, known, progress)
        stopped = np.array([(NO_HIT,)], NUMBERED)
        with Columns(OCCLUDED, queue.taken, out) as columns:
            for block in rows(answers.ordered(queue.taken), queue.taken, stopped):
                columns.put({"occluded": block["number"] == NO_HIT})
    return _answer(query, columns.arrays(), queue)


def count_intersections(
    scene: Store | str | os.PathLike[str],
    origins: Given,
    directions: Given | None = None,
    t_min: ArrayLike = 0.0,
    t_max: ArrayLike = np.inf,
    *,
    out: Out | None = None,
    progress: bool | Callable[[Progress], object] = False,
    **settings: Any,
) -> Answer:
    """Count all hits of each ray in (t_min, t_max); the parameters are `cast_rays`'.

    A sphere or cone that is crossed twice counts twice, once where it is touched.

    Returns
    -------
    Answer
        ``counts`` (n,) int64.
    """
    blocks, known = rays_of(origins, directions, t_min, t_max)
    query = _ask(scene, known, known, **settings)
    check_out(COUNTS, known, out)
    with Answers(query, COUNTED) as answers:
        queue = AskedRays(query.store, blocks, RayKind.EYE)
        sink = Forward(lambda some: answers.append(_fields(some[some["count"] > 0], COUNTED)))
        _trace(query, queue, sink, known, progress, Crossings())
        with Columns(COUNTS, queue.taken, out) as columns:
            none = np.zeros(1, COUNTED)
            for block in rows(answers.ordered(queue.taken), queue.taken, none):
                columns.put({"counts": block["count"]})
    return _answer(query, columns.arrays(), queue)


def list_intersections(
    scene: Store | str | os.PathLike[str],
    origins: Given,
    directions: Given | None = None,
    t_min: ArrayLike = 0.0,
    t_max: ArrayLike = np.inf,
    *,
    out: Out | None = None,
    progress: bool | Callable[[Progress], object] = False,
    **settings: Any,
) -> Answer:
    """Find all hits of each ray in (t_min, t_max); the parameters are `cast_rays`'.

    Returns
    -------
    Answer
        ``ray_splits`` (n + 1,) int64: ray i has the rows [ray_splits[i], ray_splits[i + 1]) of
        the other arrays, ordered by t, then id: those of `cast_rays`, and ``ray_ids`` (m,) int64.
    """
    blocks, known = rays_of(origins, directions, t_min, t_max)
    query = _ask(scene, known, None, **settings)
    folder = _folder_of(out)
    queue = AskedRays(query.store, blocks, RayKind.EYE)
    with Answers(query, ANSWER) as answers:
        with closing(Spool(HIT, query.plan.hits, query.scratch)) as hits:
            _trace(
                query,
                queue,
                Forward(lambda some: None),
                known,
                progress,
                Crossings(lambda asked: hits.append(asked.view(HIT))),
                then=lambda tracer: _resolve(tracer, query, hits, answers.append),
            )
        fields = {"ray_ids": (np.int64, ()), **HIT_FIELDS}
        with (
            Columns(fields, len(answers), folder) as columns,
            Columns(SPLITS, queue.taken + 1, folder) as splits,
        ):
            splits.put({"ray_splits": np.zeros(1, np.int64)})
            hits_before = rays_before = 0
            for block in chain(answers.ordered(queue.taken), [np.empty(0, ANSWER)]):
                numbers = block["number"].astype(np.int64)
                columns.put({"ray_ids": numbers, **_hit_columns(block)})
                rays = int(numbers[-1]) + 1 if len(numbers) else queue.taken
                for ends in split_ends(numbers, rays_before, rays):
                    splits.put({"ray_splits": hits_before + ends})
                hits_before, rays_before = hits_before + len(numbers), rays
    return _answer(query, {**splits.arrays(), **columns.arrays()}, queue)


def _folder_of(out: Out | None) -> Out | None:
    """A folder, where that is what answers go to: how many hits there are is not known before."""
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
        self._take(records.view(ASKED))


class Answers:
    """Answers as they come, to be read in the order of rays."""

    def __init__(self, query: _Query, dtype: np.dtype[Any]) -> None:
        self._room = max(1024, query.plan.queue * QUEUED_BYTES // dtype.itemsize)
        self._spool = Spool(dtype, self._room, query.scratch)
        self.append = self._spool.append

    def __len__(self) -> int:
        return len(self._spool)

    def ordered(self, rays: int) -> Iterator[NDArray[Any]]:
        return ordered(self._spool, rays, self._room)

    def __enter__(self) -> Answers:
        return self

    def __exit__(self, *_: object) -> None:
        self._spool.close()


def _ask(
    scene: Store | str | os.PathLike[str],
    rays: int | None,
    hits: int | None,
    *,
    memory: str | int | None = None,
    threads: int | None = None,
    refine: str = REFINEMENTS[-1],
    fresh_marks: bool = False,
    grid: int | None = None,
    max_grid: int | None = None,
    scratch: str | os.PathLike[str] | None = None,
) -> _Query:
    """Check the settings, and divide the budget: for so many rays and hits, where that is known."""
    store = scene if isinstance(scene, Store) else open_store(scene)
    plan, stats = plan_of(
        store, 0, 0, 1,
        memory=memory, threads=threads, refine=refine, grid=grid, max_grid=max_grid,
    )  # fmt: skip
    plan = plan if rays is None else plan.for_rays(rays)
    plan = plan if hits is None else plan.for_hits(hits)
    return _Query(store, plan, scratch_folder(scratch, store.path), refine, stats, fresh_marks)


def _trace(
    query: _Query,
    queue: AskedRays,
    sink: Forward,
    known: int | None,
    progress: bool | Callable[[Progress], object],
    crossings: Crossings | None = None,
    then: Callable[[Tracer], None] = lambda tracer: None,
) -> None:
    """Take all rays through the scene, and `then` do what needs its objects."""
    start = time.perf_counter()
    workers = Workers(query.plan.threads)
    try:
        with reporting(progress) as report:

            def tell(done: int) -> None:
                if report(Progress(1, done, queue.taken if known is None else known)) is False:
                    raise Cancelled(f"cancelled with {done} rays finished")

            tracer = Tracer(
                query.store, None, workers, query.plan, refine=query.refine,
                fresh_marks=query.fresh_marks, scratch=query.scratch, counters=query.stats.total,
                crossings=crossings,
            )  # fmt: skip
            try:
                query.stats.marks_reused = all(field.marks_reused for field in tracer.fields)
                query.stats.grids.extend(field.facts for field in tracer.fields)
                with query.stats.depth(1) as counters:
                    tracer.trace(queue, sink, counters, tell)
                    counters.rays.eye = queue.taken
                then(tracer)
            finally:
                tracer.close()
    finally:
        workers.close()
    query.stats.total.seconds = time.perf_counter() - start


def _resolve(
    tracer: Tracer, query: _Query, hits: Spool, append: Callable[[NDArray[Any]], None]
) -> None:
    """Find normals and uv of hits, object by object."""
    counters = Counters()
    with counters.phases.shading.timed():
        objects = [field.objects for field in tracer.fields]
        # Half of them, for what is found takes memory too.
        for records, begins in by_object(hits, objects, max(1, query.plan.hits // 2)):
            some = records.view(ASKED)
            found = np.empty(len(some), ANSWER)
            normals = np.empty((len(some), 3), np.float32)
            uvs = np.empty((len(some), 2), np.float32)

            def pick(
                _: int, sweep: Sweep, a: int, b: int,
                some: NDArray[Any] = some,
                normals: NDArray[np.float32] = normals,
                uvs: NDArray[np.float32] = uvs,
            ) -> None:  # fmt: skip
                surfaces(sweep, some[a:b], normals[a:b], uvs[a:b])

            ids = np.ascontiguousarray(some["id"])
            for group in objects:
                each_hit(group, ids, pick)
                counters.sweep(0, group, begins)
                counters.phases.shading.swept(group)
            found["number"], found["key"] = some["number"], some["id"]
            found["t"] = np.ldexp(some["t"] + some["moved"], -some["power"])
            found["normal"], found["uv"] = normals, uvs
            append(found)
        counters.phases.shading.spooled(hits)
    query.stats.total.add(counters)


def _fields(records: NDArray[Any], dtype: np.dtype[Any]) -> NDArray[Any]:
    """Some fields of records."""
    made = np.empty(len(records), dtype)
    for name in dtype.names or ():
        made[name] = records[name]
    return made


def _hit_columns(block: NDArray[Any]) -> dict[str, NDArray[Any]]:
    ids = block["key"]
    missed = ids == NO_HIT
    stream, index = ids >> np.uint64(INDEX_BITS), ids & np.uint64((1 << INDEX_BITS) - 1)
    return {
        "t_hit": block["t"],
        "geometry_ids": np.where(missed, MISS, stream.astype(np.int32)),
        "primitive_ids": np.where(missed, MISS, index.astype(np.int64)),
        "primitive_normals": block["normal"],
        "primitive_uvs": block["uv"],
    }


def _answer(query: _Query, arrays: dict[str, NDArray[Any]], queue: AskedRays) -> Answer:
    answer = Answer(arrays)
    answer.stats = query.stats
    query.stats.bad_rays = queue.bad
    query.stats.peak_rss_bytes = peak_rss()
    if queue.bad:
        log.warning("%d rays were NaN, infinite or of no length, and hit nothing", queue.bad)
    return answer
