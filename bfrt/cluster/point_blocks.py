"""Queries of points that are dask arrays: a task for each block, as of rays."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from bfrt.cluster.asked import Asked
from bfrt.cluster.blocks import COUNTERS, Local, columns_of, prepared_for, summed_counters, unpacked
from bfrt.cluster.engine import dask_array
from bfrt.cluster.lazy_answer import LazyAnswer, answer_of
from bfrt.cluster.lazy_rays import lazy_points
from bfrt.cluster.place import Place
from bfrt.cluster.reports import TaskReport
from bfrt.cluster.work import Work
from bfrt.cluster.worker import this_worker
from bfrt.queries.containment import Containment
from bfrt.queries.points import PointQuestion, RowPerPoint
from bfrt.store.store import Store


@dataclass(frozen=True)
class PointBlockQuery:
    """Asks about the points of one block, as a task.

    Attributes
    ----------
    work : Work
    query : RowPerPoint or Containment
    """

    work: Work
    query: RowPerPoint | Containment

    def __call__(self, points: Any, normals: Any, first: Any, prepared: Any) -> dict[str, Any]:
        """Return the arrays of the answer, with the counters beside them.

        Parameters
        ----------
        points, normals : (n, 3) or (h, w, 3) ndarray, in nested lists of one
            As Dask hands over blocks of which the rows are whole. `normals` may be None.
        first : (1,) ndarray
            The number of the block's first point.
        prepared : Prepared, or None
            What marks were made for, where there are any.
        """
        p, n = unpacked(points), unpacked(normals)
        question = PointQuestion(p, n, None, TaskReport(), first=int(first[0]))
        work = self.work if prepared is None else self.work.with_budget(prepared)
        with work.begun() as (session, settings):
            answer = self.query.answer(session.tracer, question, settings)
        return {**answer, COUNTERS: (this_worker().name, answer.stats)}


def ask_about_points(
    query: RowPerPoint | Containment,
    store: Store,
    given: tuple[Any, Any],
    asked: Asked,
    local: Local,
) -> LazyAnswer:
    """Return what a query of points will answer.

    Parameters
    ----------
    query : RowPerPoint or Containment
    store : Store
    given : tuple
        Points, and normals or None; some of them are dask arrays.
    asked : Asked
    local : Local

    Raises
    ------
    SettingError
        If points have other shapes or dtypes, or something is asked for that is not to be had.
    """
    local.check()
    points, work = lazy_points(*given), Work(Place.of(store), asked)
    prepared = prepared_for(work)
    axes = "ijk"[: 1 + len(points.lead)] + "x"
    blocks = dask_array().blockwise(
        PointBlockQuery(work, query), "i", points.points, axes,
        points.normals, None if points.normals is None else axes, points.firsts(), "i",
        prepared, None, dtype=object, meta=np.empty(0, object), token="bfrt-points",
        align_arrays=False,
    )  # fmt: skip
    arrays = columns_of(blocks, query.fields, points.lead)
    return answer_of(arrays, summed_counters(blocks, prepared))
