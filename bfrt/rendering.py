"""``bfrt.render``: a scene store in, a picture out, inside a memory budget."""

from __future__ import annotations

import logging
import os
import tempfile
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from bfrt.budget import Capacities, capacities, default_memory, parse_memory
from bfrt.errors import SettingError
from bfrt.framing import framing_camera, framing_lights
from bfrt.image.canvas import Canvas
from bfrt.image.film import Film
from bfrt.image.picture import Image
from bfrt.records import ON_REQUEST
from bfrt.scene.model import Camera, Light
from bfrt.scene.store import Store, open_store
from bfrt.scheduler import Progress, Report, render_film
from bfrt.stats import Stats, peak_rss
from bfrt.workers import usable_threads

log = logging.getLogger(__name__)

#: SPD's procedure: one ray at each pixel corner, five hits deep.
CORNERS = 0
DEPTH = 5

#: The paper's refinements, each with those before it: separation and lazy geometry; hierarchy.
REFINEMENTS = ("base", "sg", "sgb")

#: Bytes of film that are averaged at once.
BAND = 1 << 20


def render(
    scene: Store | str | os.PathLike[str],
    *,
    memory: str | int | None = None,
    threads: int | None = None,
    camera: Camera | None = None,
    samples: int | None = None,
    depth: int = DEPTH,
    aovs: Sequence[str] = (),
    refine: str = REFINEMENTS[-1],
    fresh_marks: bool = False,
    grid: int | None = None,
    max_grid: int | None = None,
    scratch: str | os.PathLike[str] | None = None,
    progress: bool | Callable[[Progress], object] = False,
) -> Image:
    """Render a scene.

    The picture is the same, bit for bit, for every memory budget and every number of threads.

    Parameters
    ----------
    scene : Store or path-like
        An open store, or where one is.
    memory : str or int, optional
        The budget of the whole process: ``"256MiB"`` or bytes. By default a quarter of the
        machine's memory, or of its cgroup's limit.
    threads : int, optional
        By default all cores that this process may use.
    camera : Camera, optional
        By default the scene's own, or where it has none one that frames it (`framing_camera`).
    samples : int, optional
        Stratified samples a pixel. By default SPD's procedure: a ray at each pixel corner, four
        averaged.
    depth : int
        Hits shaded along a path, the eye ray's included.
    aovs : sequence of {"position", "albedo"}
        Channels that the image has beside those that it always has, of each pixel's first sample:
        P.X P.Y P.Z, world coordinates, inf on a miss; albedo.R albedo.G albedo.B, the material's
        color, 0 on a miss. Each takes 12 bytes a pixel, twice while the frame is in memory.
    refine : {"sgb", "sg", "base"}
        The paper's refinements: ``base`` reads every box and all geometry wherever the original
        algorithm does; ``sg`` reads geometry only where a ray meets its box, or hits it; ``sgb``
        reads only the boxes below those of the hierarchy that are near rays. The picture is the
        same.
    fresh_marks : bool
        Make the voxel marks again, instead of using those in the store.
    grid : int, optional
        Voxels on the longest axis of each grid. By default there are about as many voxels as
        objects, as far as memory goes.
    max_grid : int, optional
        The most that there may be on that axis.
    scratch : path-like, optional
        Folder for spools, and for marks where the store is read-only. By default the store's
        parent, or the system's temporary folder where that is read-only.
    progress : bool or callable
        True shows a bar (needs tqdm, and a terminal). A callable gets a `Progress` after each
        pass; returning False cancels.

    Returns
    -------
    Image
        R G B A, Z, N and object ids, and the `aovs`; `Image.stats` has the counters.

    Raises
    ------
    StoreError
        If the store is damaged.
    BudgetError
        If the budget is below the least that works, which the message names.
    SettingError
        If a setting cannot be honoured. If there is no camera, and no object that one could frame.
    Cancelled
        If `progress` returned False.
    DiskFullError, StreamError
        As the system refuses.
    """
    start = time.perf_counter()
    store = scene if isinstance(scene, Store) else open_store(scene)
    store, view, added = seen(store, camera)
    corners, kept = samples_of(samples), aovs_of(aovs)
    plan, stats = plan_of(
        store, *view.resolution, corners, kept,
        memory=memory, threads=threads, refine=refine, grid=grid, max_grid=max_grid,
    )  # fmt: skip
    stats.settings["depth"] = at_least_one("depth", depth)
    folder = scratch_folder(scratch, store.path)
    canvas = Canvas(*view.resolution, folder if plan.frame_on_disk else None)
    with reporting(progress) as report:
        render_film(
            store,
            view,
            samples=corners,
            depth=depth,
            aovs=kept,
            capacities=plan,
            refine=refine,
            fresh_marks=fresh_marks,
            scratch=folder,
            stats=stats,
            report=report,
            take=lambda film: develop(film, canvas),
        )
    image = Image(canvas.channels(), describe(store, view, corners, depth, added), stats)
    stats.total.seconds = time.perf_counter() - start
    stats.peak_rss_bytes = peak_rss()
    if stats.bad_rays:
        log.warning("%d rays were NaN or had no direction, and hit nothing", stats.bad_rays)
    return image


def seen(store: Store, camera: Camera | None) -> tuple[Store, Camera, list[Light]]:
    """The scene as it is lit, the view of it, and which of its lights were added to it."""
    view = camera or store.camera or framing_camera(store)
    added = [] if store.lights else framing_lights(store, view)
    return replace(store, lights=[*store.lights, *added]), view, added


def samples_of(samples: int | None) -> int:
    """Samples a pixel that are asked for, or `CORNERS`."""
    return CORNERS if samples is None else at_least_one("samples", samples)


def plan_of(
    store: Store,
    width: int,
    height: int,
    samples: int,
    aovs: Sequence[str] = (),
    *,
    memory: str | int | None,
    threads: int | None,
    refine: str,
    grid: int | None,
    max_grid: int | None,
) -> tuple[Capacities, Stats]:
    """Check the settings that renders and ray queries share, divide the budget, and begin the
    counters; all as for `render` and `capacities`."""
    budget = default_memory() if memory is None else parse_memory(memory)
    count = usable_threads() if threads is None else at_least_one("threads", threads)
    if refine not in REFINEMENTS:
        raise SettingError(f"refine: found {refine!r}, expected one of {', '.join(REFINEMENTS)}")
    plan = capacities(
        store,
        width,
        height,
        samples,
        budget,
        count,
        aovs=aovs,
        grid=None if grid is None else at_least_one("grid", grid),
        max_grid=None if max_grid is None else at_least_one("max_grid", max_grid),
    )
    stats = Stats(
        objects=store.objects,
        scene_bytes=store.bytes,
        settings={"refine": refine, "memory": budget, "threads": count},
    )
    if refine == "sgb":
        stats.hierarchy_seconds = store.hierarchy_seconds
    return plan, stats


def develop(film: Film, canvas: Canvas) -> None:
    """Add the rows that the film holds to the image, a few at a time."""
    rows = max(1, BAND // (film.shape[1] * 64))
    for first in range(film.row, film.end, rows):
        canvas.add(film.rows(first, min(first + rows, film.end)))


def describe(
    store: Store, camera: Camera, samples: int, depth: int, added: list[Light]
) -> dict[str, str]:
    """Metadata: the scene and what changes the picture, lights that were added to it too; not
    threads, budget or time."""
    facts = {
        "scene": store.path.stem,
        "objects": str(store.objects),
        "checksum": f"{store.checksum:08x}",
        "eye": digits(camera.eye),
        "at": digits(camera.at),
        "up": digits(camera.up),
        "angle": digits([camera.angle]),
        "samples": str(samples) if samples else "corners",
        "depth": str(depth),
    }
    if added:
        lights = (digits([*position, *color]) for position, color in added)
        facts["lights"] = f"automatic: {', '.join(lights)}"
    return facts


def digits(numbers: Iterable[float]) -> str:
    """Numbers as metadata has them, so long that map coordinates are told apart."""
    return " ".join(f"{x:.15g}" for x in numbers)


def aovs_of(names: Sequence[str]) -> tuple[str, ...]:
    """Those of `records.ON_REQUEST` that are named, in its order."""
    unknown = [name for name in names if name not in ON_REQUEST]
    if unknown or isinstance(names, str):
        found = repr(names if isinstance(names, str) else unknown[0])
        raise SettingError(f"aovs: found {found}, expected a sequence of {', '.join(ON_REQUEST)}")
    return tuple(name for name in ON_REQUEST if name in names)


def at_least_one(name: str, value: int) -> int:
    """The value, if it is a whole number of 1 or more."""
    if isinstance(value, bool) or not isinstance(value, (int, np.integer)) or value < 1:
        raise SettingError(f"{name}: found {value!r}, expected a whole number of 1 or more")
    return int(value)


def scratch_folder(scratch: str | os.PathLike[str] | None, beside: Path) -> Path:
    """The folder for spools."""
    if scratch is not None:
        folder = Path(scratch)
        if not folder.is_dir():
            raise SettingError(f"scratch: found {folder}, expected a folder that is there")
        return folder
    parent = beside.resolve().parent
    return parent if os.access(parent, os.W_OK) else Path(tempfile.gettempdir())


@contextmanager
def reporting(progress: bool | Callable[[Progress], object]) -> Iterator[Report]:
    """What the scheduler reports to."""
    if progress is False:
        yield lambda _: None
    elif progress is not True:
        yield progress
    else:
        with Bar() as bar:
            yield bar.show


class Bar:
    """A tqdm bar a depth: rays finished, of the depth's rays."""

    def __init__(self) -> None:
        try:
            from tqdm import tqdm
        except ImportError:
            raise SettingError("progress: a bar needs tqdm: install bfrt[progress]") from None
        self._tqdm = tqdm
        self._bar: Any = None
        self._where = (0, 0)

    def show(self, progress: Progress) -> None:
        if (progress.band, progress.depth) != self._where:
            self._close()
            self._where = (progress.band, progress.depth)
            band = f"band {progress.band} of {progress.bands}, " if progress.bands > 1 else ""
            self._bar = self._tqdm(
                total=progress.total,
                desc=f"{band}depth {progress.depth}",
                unit=" rays",
                unit_scale=True,
                disable=None,
            )
        self._bar.update(progress.done - self._bar.n)

    def _close(self) -> None:
        if self._bar is not None:
            self._bar.close()

    def __enter__(self) -> Bar:
        return self

    def __exit__(self, *_: object) -> None:
        self._close()
