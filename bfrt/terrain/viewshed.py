"""``bfrt.viewshed``: which pixels of a terrain are seen from where somebody stands."""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import closing, contextmanager
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from bfrt.conversion.convert import convert
from bfrt.errors import BudgetError, SettingError
from bfrt.formats.raster.reader import Terrain, opened
from bfrt.formats.raster.remote import RemoteRaster
from bfrt.formats.raster.suffixes import DRIVERS
from bfrt.formats.reading import Reading
from bfrt.formats.remote.process import Library, RemoteFile, is_installed
from bfrt.formats.room import need_of
from bfrt.memory import BASELINE, default_memory, format_memory, parse_memory
from bfrt.paths import check_apart, path_of
from bfrt.progress import DoneReport, check_report, staged
from bfrt.refusals import calling, in_memory
from bfrt.scene import PathLike, Scene
from bfrt.settings import scratch_folder
from bfrt.streams.atomic_write import atomic_path
from bfrt.streams.litter import sweep
from bfrt.streams.ownership import create_folder
from bfrt.streams.writer import FileWriter
from bfrt.terrain.asked import REFRACTION, Sight, checked, heights_of, positions_of
from bfrt.terrain.ground import ROWS_BYTES, Ground, Observer, write_ground

#: What a pixel has that is seen, and one that is not; as GDAL's viewshed.
SEEN, UNSEEN = 255, 0

#: The part of a ray at either end where nothing counts: it begins and ends on the ground.
END = 1e-6

#: What a file's writing takes beside this process.
WRITER_BYTES = 80 << 20

SHEET = Library("GDAL", "bfrt.terrain.sheet", "a GeoTIFF that it writes")


class Files(NamedTuple):
    """Names the files of a viewshed that is being made, and the place for them.

    Attributes
    ----------
    raster, out : str
        What is read, and what is made.
    folder : Path
        For what goes at the end.
    """

    raster: str
    out: str
    folder: Path


def viewshed(
    raster: PathLike,
    out: PathLike,
    observers: ArrayLike,
    *,
    height: ArrayLike = 2.0,
    target_height: float = 0.0,
    max_distance: float | None = None,
    curvature: bool = False,
    refraction: float | None = None,
    band: int | None = None,
    height_scale: float | None = None,
    memory: str | int | None = None,
    threads: int | None = None,
    scratch: PathLike | None = None,
    progress: DoneReport | None = None,
) -> NDArray[np.int64]:
    """Find which pixels of a terrain each observer sees, and write them as a GeoTIFF.

    The terrain is converted to a scene: two triangles between the middles of four pixels. A pixel
    is seen if nothing of it is between the eye and the pixel's middle, `target_height` above the
    ground there.

    Parameters
    ----------
    raster : path-like
        A raster of heights that `convert` reads.
    out : path-like
        The GeoTIFF to make, with the size, the transform and the reference system of `raster`: a
        band of bytes for each observer, 255 where it sees the ground and 0 elsewhere, where there
        is no ground too.
    observers : (n, 2) or (2,) array_like
        x and y of each, in the raster's reference system.
    height : float or (n,) array_like
        Of the eyes above the ground there, above 0, in the raster's units of heights.
    target_height : float
        Of what is looked at above the ground of its pixel, likewise; 0 or more.
    max_distance : float, optional
        How far observers see, in units of x and y. By default as far as there is terrain.
    curvature : bool
        Whether the earth is round: heights are lower by ``(1 - refraction) d^2 / 2R`` at a
        distance d, R being the larger half axis of the reference system's ellipsoid.
    refraction : float, optional
        The part that the air's refraction takes back. By default 1/7, as of light near the ground,
        and of `gdal_viewshed`, whose ``-cc`` is 1 - refraction. It goes with `curvature`.
    band : int, optional
        The band that has the heights, from 1. By default the first.
    height_scale : float, optional
        What heights, those of eyes and targets too, are multiplied by to be in units of x and y.
        It is asked for where these are degrees.
    memory : str or int, optional
        The budget of the whole process and of those that it begins, as for `convert`.
    threads : int, optional
        As for `render`.
    scratch : path-like, optional
        Folder for the scene and for what does not fit in memory. By default that of `out`.
    progress : callable, optional
        Called with a `bfrt.progress.Done` of the stages "reading", "ordering" and "looking", the
        last in pixels of all observers. Returning False cancels.

    Returns
    -------
    (n,) ndarray of int64
        The number of pixels that each observer sees.

    Raises
    ------
    SceneError, ShortReadError
        If the raster is broken.
    SettingError
        If a setting cannot be honoured, or an observer stands where there is no ground.
    BudgetError, ResourceError, StreamError, DiskFullError, Cancelled
        As for `convert`. Nothing is left behind.

    Notes
    -----
    One scene serves all observers, with curvature too: heights are lowered from the raster's
    middle, which changes no line of sight between any two points (docs/sight.rst).
    """
    if refraction is not None and not curvature:
        raise SettingError("refraction: found without curvature, expected with it only")
    part = 1.0 - (REFRACTION if refraction is None else checked("refraction", refraction))
    check_report(progress)
    files = Files(str(path_of("raster", raster)), str(path_of("out", out)), Path())
    positions = positions_of(observers)
    sight = Sight(
        positions,
        heights_of(height, len(positions)),
        checked("target_height", target_height, least=0.0),
        math.inf if max_distance is None else checked("max_distance", max_distance, above=0.0),
        Reading(band=band, height_scale=height_scale, curvature=part if curvature else None),
        default_memory() if memory is None else parse_memory(memory),
        threads,
    )
    check_files(files)
    with in_memory(f"{files.raster}: looking", sight.memory), folder_for(files, scratch) as own:
        return look(own, sight, progress)


def look(files: Files, sight: Sight, progress: DoneReport | None) -> NDArray[np.int64]:
    """Make the viewshed, in a folder for what goes at the end."""
    memory = sight.memory - ROWS_BYTES
    least = max(need_of(files.raster).least, BASELINE + WRITER_BYTES) + ROWS_BYTES
    if sight.memory < least:
        raise BudgetError(
            f"memory: found {sight.memory >> 20}MiB, expected {format_memory(least)} or more to "
            f"look at {files.raster}"
        )
    reading = sight.reading
    with closing(terrain_of(files, sight)) as raster:
        terrain = Terrain(files.raster, raster, reading)
        lowest = write_ground(terrain, files.folder / "ground")
    scene = convert(
        files.raster, files.folder / "terrain.bfrt", band=reading.band,
        height_scale=reading.height_scale, curvature=reading.curvature, floor=lowest,
        memory=memory, scratch=files.folder, progress=progress, durable=False,
    )  # fmt: skip
    with scene:
        place = terrain.facts.place
        lift = sight.target_height * sight.scale
        ground = Ground(place, scene.origin, files.folder / "ground", lift)
        seen = look_from_each(scene, ground, files, sight, progress)
    with atomic_path(files.out) as temporary:
        about = (str(temporary), files.out, len(seen), place)
        RemoteFile(str(files.folder / "seen"), about, SHEET).close()
    return seen


def terrain_of(files: Files, sight: Sight) -> RemoteRaster:
    """Open the raster again, with the room that is there beside."""
    room = sight.memory - ROWS_BYTES - need_of(files.raster).blocks
    return opened(files.raster, Reading(band=sight.reading.band, room=room))


def look_from_each(
    scene: Scene, ground: Ground, files: Files, sight: Sight, progress: DoneReport | None
) -> NDArray[np.int64]:
    """Write what each observer sees, a byte a pixel; return the number of pixels of each."""
    eyes = eyes_of(scene, sight)
    place = ground.place
    pixels = place.width * place.height
    report = staged(progress, "looking", pixels * len(eyes))
    counts = np.zeros(len(eyes), np.int64)
    with FileWriter(files.folder / "seen", False) as file:
        for k, eye in enumerate(eyes):
            observer = Observer(eye, sight.reach)
            answer = scene.occluded(
                rays_from(observer, ground), t_min=END, t_max=1.0 - END,
                out=files.folder / "occluded", memory=sight.memory - ROWS_BYTES,
                threads=sight.threads, scratch=files.folder,
            )  # fmt: skip
            for block in seen_of(observer, ground, answer["occluded"]):
                counts[k] += np.count_nonzero(block)
                file.write(block)
            del answer
            if report is not None:
                report(pixels * (k + 1))
    return counts


def rays_from(observer: Observer, ground: Ground) -> Iterator[tuple[Any, Any]]:
    """Yield rays from an eye to all pixels that it may see, in blocks."""
    for ways, _ in ground.ways(observer):
        yield np.broadcast_to(observer.eye, ways.shape), ways


def seen_of(
    observer: Observer, ground: Ground, occluded: NDArray[np.bool_]
) -> Iterator[NDArray[np.uint8]]:
    """Yield what an observer sees, some rows at a time, (rows, width)."""
    done = 0
    for ways, chosen in ground.ways(observer):
        block = np.full(chosen.shape, UNSEEN, np.uint8)
        block[chosen] = np.where(occluded[done : done + len(ways)], UNSEEN, SEEN)
        done += len(ways)
        yield block


def eyes_of(scene: Scene, sight: Sight) -> list[tuple[float, float, float]]:
    """Return where the eyes are, by rays down to the ground.

    Raises
    ------
    SettingError
        For the first observer that has no ground.
    """
    bounds = scene.bounds
    if bounds.empty:
        raise SettingError("observers: found a raster without ground, expected them on it")
    top = float(bounds.hi[2]) + 1.0
    count = len(sight.positions)
    above = np.column_stack([sight.positions, np.full(count, top)])
    down = np.broadcast_to((0.0, 0.0, -1.0), above.shape)
    depth = scene.cast_rays(above, down, memory=sight.memory, threads=sight.threads)["t_hit"]
    for k in np.flatnonzero(np.isinf(depth)):
        x, y = sight.positions[k]
        raise SettingError(
            f"observers: found no ground at {x:.12g} {y:.12g}, where observer {k} is, expected "
            f"places from {bounds.lo[0]:.12g} {bounds.lo[1]:.12g} to {bounds.hi[0]:.12g} "
            f"{bounds.hi[1]:.12g} that have heights"
        )
    z = top - depth + sight.heights * sight.scale
    return [(float(x), float(y), float(h)) for (x, y), h in zip(sight.positions, z, strict=True)]


def check_files(files: Files) -> None:
    """Refuse a raster that no driver reads, and a file to make that is the raster or has no name.

    Raises
    ------
    SettingError
    """
    for name, known in ((files.raster, tuple(DRIVERS)), (files.out, (".tif", ".tiff"))):
        if Path(name).suffix.lower() not in known:
            raise SettingError(
                f"{name}: found suffix {Path(name).suffix!r}, expected {', '.join(known)}"
            )
    if not is_installed("rasterio"):
        raise SettingError(f"{files.raster}: found no rasterio, expected it: install bfrt[raster]")
    check_apart(files.raster, files.out)


@contextmanager
def folder_for(files: Files, scratch: PathLike | None) -> Iterator[Files]:
    """Give a folder for what goes at the end."""
    place = scratch_folder(scratch, Path(files.out))
    sweep(place)
    with calling(place, "creating"):
        owned = create_folder(place / Path(files.out).name, 0o700)
    try:
        yield files._replace(folder=owned.path)
    finally:
        owned.remove()
