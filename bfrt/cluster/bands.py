"""A frame on many workers: each renders bands of rows, and the client puts their films together."""

from __future__ import annotations

import itertools
import time
from dataclasses import dataclass
from typing import Any

from bfrt.cluster.asked import Asked
from bfrt.cluster.counters import Part, summed
from bfrt.cluster.place import Place
from bfrt.cluster.reports import TaskReport
from bfrt.cluster.watching import Watch
from bfrt.cluster.work import Prepared, Work
from bfrt.cluster.worker import this_worker
from bfrt.image.film import Film
from bfrt.image.film_bands import Planes, add_bands
from bfrt.image.frame import FRAME_PART, FrameSize
from bfrt.image.image_buffer import ImageBuffer
from bfrt.image.pictures import Images
from bfrt.memory import default_memory
from bfrt.phases.eye import count_eye_rays
from bfrt.progress import Report
from bfrt.rendering import band_of, images_of, tell_of_bad_rays
from bfrt.settings import scratch_folder
from bfrt.stats import Stats
from bfrt.store.store import Store
from bfrt.view import Views

#: The film of a band, and the counters of its worker.
Band = tuple[Planes, Part]


@dataclass(frozen=True)
class Preparing:
    """Gets a store ready for a frame that so many workers share, as a task."""

    work: Work
    frame: FrameSize

    def __call__(self, workers: int) -> Prepared:
        return self.work.prepare(self.frame, workers)


@dataclass(frozen=True)
class Rendering:
    """Renders bands of a frame, as a task for each: the rows from one on, up to another.

    Attributes
    ----------
    work : Work
    views : Views
    topic : str, optional
        Where messages go.
    """

    work: Work
    views: Views
    topic: str | None

    def __call__(self, band: tuple[int, int, int]) -> Band:
        number, row, end = band
        frame = self.views.frame._replace(band=end - row)
        report = TaskReport(self.topic, number)
        with self.work.begun() as (session, settings):
            with session.tracer(settings, frame) as tracer:
                planes, stats = band_of(tracer, self.views, row, report)
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
        Gets the sum over all bands.

    Raises
    ------
    StoreError, BudgetError, SettingError, Cancelled, DiskFullError, StreamError
        As `bfrt.render`; those of a store or a budget name the worker.
    """
    start = time.perf_counter()
    work, frame = Work(Place.of(store), asked), views.frame
    width, height = frame.width, frame.height
    with Watch(client, count_eye_rays(frame), report) as watch:
        workers = max(1, len(client.nthreads()))
        (preparing,) = watch.begin(Preparing(work, frame), [workers], "prepare")
        prepared: Prepared = watch.result(preparing)
        task = Rendering(work.with_budget(prepared), views, watch.topic)
        rows, starts = prepared.bands.rows, prepared.bands.starts(height)
        film = Film(width, height, views.samples, rows, views.aovs, frame.views)
        image = ImageBuffer(width, height, scratch_of(store, views), frame.views)
        parts = [prepared.part]
        bands = [(n, *ends) for n, ends in enumerate(itertools.pairwise(starts))]
        for (number, row, end), errand in zip(bands, watch.begin(task, bands, "band"), strict=True):
            planes, part = watch.result(errand)
            add_bands(film, planes, image, -(-(end - row) // rows))
            parts.append(part)
            watch.through(number, rays_of(part[1]))
    stats = summed(parts)
    stats.settings = dict(part[1].settings)
    stats.total.seconds = time.perf_counter() - start
    tell_of_bad_rays(stats)
    return images_of(image, store, views, stats)


def scratch_of(store: Store, views: Views) -> Any:
    """Return the client's folder for pictures that its memory has no room for; else None."""
    if views.frame.whole_bytes <= FRAME_PART * default_memory():
        return None
    return scratch_folder(None, store.path)


def rays_of(stats: Stats) -> int:
    """Return the number of rays of all kinds and depths."""
    rays = stats.total.rays
    return rays.eye + rays.reflection + rays.refraction + rays.shadow
