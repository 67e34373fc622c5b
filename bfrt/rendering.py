"""``bfrt.render``: a scene store in, pictures out, inside a memory budget."""

from __future__ import annotations

import logging
import time
from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from bfrt.checkpoint.checkpoint import Checkpoint
from bfrt.illumination import Illumination, light_intensity
from bfrt.image.film_rows import Planes, first_rows
from bfrt.image.image_buffer import ImageBuffer
from bfrt.image.picture import Image
from bfrt.image.pictures import Images
from bfrt.progress import Report
from bfrt.scheduler import Render
from bfrt.stats import Stats, peak_rss
from bfrt.store.model import Light
from bfrt.store.store import Store
from bfrt.store.sun import Sun
from bfrt.tracer import Tracer
from bfrt.view import View, Views

log = logging.getLogger(__name__)


def pictures_of(
    tracer: Tracer, views: Views, report: Report, checkpoint: Checkpoint | None = None
) -> Images:
    """Trace views of a scene into a picture of each.

    Parameters
    ----------
    tracer : Tracer
        A session on the scene, with capacities for the views' frame.
    views : Views
    report : Report
        Called after each pass; returning False cancels.
    checkpoint : Checkpoint, optional
        Keeps the state; the render goes on from the one that it has found.

    Raises
    ------
    StoreError, Cancelled, DiskFullError, StreamError
        As `bfrt.render`.
    """
    start = time.perf_counter()
    store = tracer.store
    stats = stats_of(tracer)
    stats.settings["depth"] = views.depth
    buffer = Render(tracer, views, stats, report, checkpoint).run()
    images = images_of(buffer, store, views, stats)
    stats.total.seconds += time.perf_counter() - start
    stats.peak_rss_bytes = peak_rss()
    tell_of_bad_rays(stats)
    return images


def images_of(buffer: ImageBuffer, store: Store, views: Views, stats: Stats) -> Images:
    """Return the finished pictures of views, with their metadata."""
    made = zip(buffer.each(), views.each, strict=True)
    return Images(Image(channels, describe(store, views, view), stats) for channels, view in made)


def tell_of_bad_rays(stats: Stats) -> None:
    """Log how many rays of a render were bad, if any were."""
    if stats.bad_rays:
        log.warning("%d rays were NaN or had no direction, and hit nothing", stats.bad_rays)


def rows_of(
    tracer: Tracer, views: Views, rows: NDArray[np.uint32], report: Report
) -> tuple[Planes, Stats]:
    """Trace some rows of views: what many workers share a frame by.

    Parameters
    ----------
    tracer : Tracer
        A session on the scene, with capacities for bands of as many of the frame's rows.
    views : Views
    rows : (n,) uint32
        Which rows of the frame's film elements: pixels, or corners.
    report : Report
        Called after each pass.

    Returns
    -------
    planes : list of ndarray
        The film of these rows.
    stats : Stats

    Raises
    ------
    StoreError, DiskFullError, StreamError
        As `bfrt.render`.
    """
    start = time.perf_counter()
    stats = stats_of(tracer)
    stats.settings["depth"] = views.depth
    film = Render(tracer, views, stats, report).run_rows(rows)
    stats.total.seconds += time.perf_counter() - start
    stats.peak_rss_bytes = peak_rss()
    return first_rows(film, len(rows)), stats


def stats_of(tracer: Tracer) -> Stats:
    """Begin the counters of a render or a query."""
    store, settings = tracer.store, tracer.settings
    refinement = settings.refinement
    return Stats(
        objects=store.objects,
        scene_bytes=store.bytes,
        settings={
            "refine": refinement.name,
            "memory": settings.memory,
            "threads": settings.threads,
        },
        hierarchy_seconds=store.hierarchy_seconds if refinement.hierarchy else 0.0,
    )


def describe(store: Store, views: Views, view: View) -> dict[str, str]:
    """Return metadata: the scene and all that changes the picture of a view, added lights included.

    Threads, budget and time change nothing, and are left out; so is light that is the scene's own.
    """
    camera = view.camera
    facts = {
        "scene": store.path.stem,
        "objects": str(store.objects),
        "checksum": f"{store.checksum:08x}",
        "eye": digits(camera.eye),
        "at": digits(camera.at),
        "up": digits(camera.up),
        "angle": digits([camera.angle]),
        "samples": str(views.samples) if views.samples else "corners",
        "depth": str(views.depth),
    }
    return facts | describe_light(store, view.illumination)


def describe_light(store: Store, light: Illumination) -> dict[str, str]:
    """Return metadata of light that is not the scene's own."""
    facts = {}
    if light.lights != tuple(store.lights) or not light.lights:
        which = "automatic: " if light.added else ""
        facts["lights"] = which + (", ".join(map(described, light.lights)) or "none")
    if light.ambient != light_intensity(len(light.lights)):
        facts["ambient"] = digits([light.ambient])
    if light.ao:
        facts["ao"] = str(light.ao)
        facts["ao_distance"] = digits([light.ao_distance])
    if light.background != store.background:
        facts["background"] = digits(light.background)
    return facts


def described(light: Light | Sun) -> str:
    """Return a light as metadata has it: a sun by azimuth and elevation, then the color."""
    if isinstance(light, Sun):
        return f"sun {digits([light.azimuth, light.elevation, *light.strength])}"
    return digits([*light.position, *light.color])


def digits(numbers: Iterable[float]) -> str:
    """Return numbers as metadata has them, with digits enough to tell map coordinates apart."""
    return " ".join(f"{x:.15g}" for x in numbers)
