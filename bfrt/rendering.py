"""``bfrt.render``: a scene store in, a picture out, inside a memory budget."""

from __future__ import annotations

import logging
import time
from collections.abc import Iterable

from bfrt.checkpoint.checkpoint import Checkpoint
from bfrt.illumination import Illumination, light_intensity
from bfrt.image.film_bands import Planes, own_planes
from bfrt.image.picture import Image
from bfrt.progress import Report
from bfrt.scheduler import Render
from bfrt.stats import Stats, peak_rss
from bfrt.store.model import Light
from bfrt.store.store import Store
from bfrt.store.sun import Sun
from bfrt.tracer import Tracer
from bfrt.view import View

log = logging.getLogger(__name__)


def picture_of(
    tracer: Tracer, view: View, report: Report, checkpoint: Checkpoint | None = None
) -> Image:
    """Trace a view of a scene into a picture.

    Parameters
    ----------
    tracer : Tracer
        A session on the scene, with capacities for the view's frame.
    view : View
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
    stats.settings["depth"] = view.depth
    buffer = Render(tracer, view, stats, report, checkpoint).run()
    image = Image(buffer.channels(), describe(store, view), stats)
    stats.total.seconds += time.perf_counter() - start
    stats.peak_rss_bytes = peak_rss()
    tell_of_bad_rays(stats)
    return image


def tell_of_bad_rays(stats: Stats) -> None:
    """Log how many rays of a render were bad, if any were."""
    if stats.bad_rays:
        log.warning("%d rays were NaN or had no direction, and hit nothing", stats.bad_rays)


def band_of(tracer: Tracer, view: View, row: int, report: Report) -> tuple[Planes, Stats]:
    """Trace one band of a view: what many workers share a frame by.

    Parameters
    ----------
    tracer : Tracer
        A session on the scene, with capacities for bands of the view's frame.
    view : View
    row : int
        The first of the band.
    report : Report
        Called after each pass.

    Returns
    -------
    planes : list of ndarray
        The film of the elements that no band before it has (`own_planes`).
    stats : Stats

    Raises
    ------
    StoreError, DiskFullError, StreamError
        As `bfrt.render`.
    """
    start = time.perf_counter()
    stats = stats_of(tracer)
    stats.settings["depth"] = view.depth
    film = Render(tracer, view, stats, report).run_band(row)
    stats.total.seconds += time.perf_counter() - start
    stats.peak_rss_bytes = peak_rss()
    return own_planes(film), stats


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


def describe(store: Store, view: View) -> dict[str, str]:
    """Return metadata: the scene and all that changes the picture, added lights included.

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
        "samples": str(view.samples) if view.samples else "corners",
        "depth": str(view.depth),
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
