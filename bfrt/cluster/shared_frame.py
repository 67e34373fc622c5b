"""A frame on many workers: each renders some of its rows, and the client puts films together."""

from __future__ import annotations

import itertools
import time
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bfrt.cluster.asked import Asked
from bfrt.cluster.counters import Part, summed
from bfrt.cluster.division import Division
from bfrt.cluster.place import Place
from bfrt.cluster.reports import TaskReport
from bfrt.cluster.watching import Watch
from bfrt.cluster.work import Prepared, Work
from bfrt.cluster.worker import this_worker
from bfrt.image.film import Film
from bfrt.image.film_rows import Planes, put_rows
from bfrt.image.frame import FrameSize, held_frame
from bfrt.image.image_buffer import ImageBuffer, resolve
from bfrt.image.pictures import Images
from bfrt.memory import BASELINE, default_memory
from bfrt.phases.eye import count_eye_rays
from bfrt.phases.traversal import FEWEST_RAYS
from bfrt.progress import Report
from bfrt.rendering import images_of, rows_of, tell_of_bad_rays
from bfrt.settings import scratch_folder
from bfrt.stats import Stats
from bfrt.store.store import Store
from bfrt.view import Views

#: Rows of elements, by their numbers in a frame, and the number of the task that traces them.
Rows = tuple[int, NDArray[np.uint32]]

#: The film of a part, and the counters of its worker.
Traced = tuple[Planes, Part]


@dataclass(frozen=True)
class Preparing:
    """Gets a store ready for a frame that so many workers share, as a task.

    Attributes
    ----------
    work : Work
    frame : FrameSize
    rows : int
        Pixel rows that the client's memory holds.
    """

    work: Work
    frame: FrameSize
    rows: int

    def __call__(self, workers: int) -> Prepared:
        return self.work.prepare(self.frame, workers, self.rows)


@dataclass(frozen=True)
class Rendering:
    """Renders parts of a frame, as a task for each.

    Attributes
    ----------
    work : Work
    views : Views
    division : Division
    topic : str, optional
        Where messages go.
    """

    work: Work
    views: Views
    division: Division
    topic: str | None

    def __call__(self, part: Rows) -> Traced:
        number, rows = part
        frame = self.views.frame._replace(band=self.division.held)
        report = TaskReport(self.topic, number)
        with self.work.begun() as (session, settings):
            with session.tracer(settings, frame) as tracer:
                planes, stats = rows_of(tracer, self.views, rows, report)
            return planes, (this_worker().name, stats)


def render(client: Any, store: Store, views: Views, asked: Asked, report: Report | None) -> Images:
    """Render views on the workers of a cluster, as `bfrt.render` does here.

    Parameters
    ----------
    client : distributed.Client
    store : Store
    views : Views
    asked : Asked
    report : Report, optional
        Gets the sum over all parts.

    Raises
    ------
    StoreError, BudgetError, SettingError, Cancelled, DiskFullError, StreamError
        As `bfrt.render`; those of a store or a budget name the worker.
    """
    start = time.perf_counter()
    work, frame = Work(Place.of(store), asked), views.frame
    width, height = frame.width, frame.height
    held = held_frame(frame, default_memory() - BASELINE, FEWEST_RAYS)
    scratch = scratch_folder(None, store.path) if held.on_disk else None
    with Watch(client, count_eye_rays(frame), report) as watch:
        workers = max(1, len(client.nthreads()))
        (preparing,) = watch.begin(Preparing(work, frame, held.rows), [workers], "prepare")
        prepared: Prepared = watch.result(preparing)
        division = prepared.division
        task = Rendering(work.with_budget(prepared), views, division, watch.topic)
        bands = [division.parts_of(rows) for rows in division.bands(frame)]
        errands = iter(watch.begin(task, list(enumerate(itertools.chain(*bands))), "part"))
        film = Film(width, height, frame.samples, division.rows, frame.aovs, frame.views)
        image = ImageBuffer(width, height, scratch, frame.views)
        parts = [prepared.part]
        for band in bands:
            for rows in band:
                number = len(parts) - 1
                planes, part = watch.result(next(errands))
                put_rows(film, rows, planes)
                parts.append(part)
                watch.through(number, rays_of(part[1]))
            resolve(film, image)
            film.advance()
    stats = summed(parts)
    stats.settings = dict(part[1].settings)
    stats.total.seconds = time.perf_counter() - start
    tell_of_bad_rays(stats)
    return images_of(image, store, views, stats)


def rays_of(stats: Stats) -> int:
    """Return the number of rays of all kinds and depths."""
    rays = stats.total.rays
    return rays.eye + rays.reflection + rays.refraction + rays.shadow
