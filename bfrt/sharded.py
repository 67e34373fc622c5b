"""``bfrt.open(path, client=...)``: a sharded scene whose shards stay with a cluster's workers."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from html import escape
from pathlib import Path
from typing import Any, overload

import numpy as np
from numpy.typing import ArrayLike

from bfrt import cluster, queries, wavefront
from bfrt.errors import SettingError
from bfrt.framing import turntable
from bfrt.ids import kind_of
from bfrt.illumination import LightAsked
from bfrt.image.color_scale import ColorScale
from bfrt.image.picture import Image
from bfrt.image.pictures import Images
from bfrt.notebook import bounds_rows, color_rows, table
from bfrt.paths import path_of
from bfrt.progress import Report, reporting
from bfrt.refusals import in_memory
from bfrt.scene import Geometry, PathLike, Scene
from bfrt.scene import open_scene as open_here
from bfrt.settings import FINEST
from bfrt.shards.manifest import SUFFIX, Manifest
from bfrt.store.extent import Bounds
from bfrt.store.model import Camera, Light, Vector
from bfrt.store.sun import Sun
from bfrt.view import DEPTH, Cameras, Views, asked_for, preview_camera


class ShardedScene:
    """Renders a sharded scene, whose shards are opened by workers alone, and answers ray queries.

    Each shard has a worker that answers for it. Rays go to the workers whose shards' bounds they
    meet, nearest first, and no further than to the nearest hit; answers are the same, bit for bit,
    as those of `Scene`. `bfrt.open` makes one.

    Parameters
    ----------
    path : path-like
        The file of a sharded scene, under the same path for this process and all workers.
    client : distributed.Client or True
        True is the current client.
    """

    def __init__(self, path: PathLike, client: Any) -> None:
        self._path = path_of("store", path)
        if self._path.suffix != SUFFIX:
            raise SettingError(
                f"client: found one for {self._path}, expected a sharded scene ({SUFFIX}): other "
                "scenes take it with each call"
            )
        self._wavefront = wavefront.Wavefront(client, self._path)

    def __repr__(self) -> str:
        workers = len(self._wavefront.carriers)
        return f"<ShardedScene {str(self.path)!r}: {self.objects:,} objects, {workers} workers>"

    def _repr_html_(self) -> str:
        shards = len(self._manifest.shards)
        facts = [("objects", f"{self.objects:,}"), ("shards", f"{shards:,}")]
        workers = [(name, f"{len(own):,} shards") for name, own in self.workers.items()]
        shown = [*facts, *bounds_rows(self.bounds), *color_rows(self.colors), *workers]
        return f"<b>{escape(str(self.path))}</b>{table(shown)}"

    @property
    def _manifest(self) -> Manifest:
        return self._wavefront.store.manifest

    @property
    def path(self) -> Path:
        """Return the path of the scene's file."""
        return self._path

    @property
    def objects(self) -> int:
        """Return the number of objects of all shards."""
        return self._manifest.objects

    @property
    def origin(self) -> tuple[float, float, float]:
        """Return the point, in world coordinates, that the shards' coordinates count from."""
        return self._manifest.origin

    @property
    def bounds(self) -> Bounds:
        """Return the box around all objects, world coordinates, as `Scene.bounds`."""
        return self._wavefront.store.world_bounds

    @property
    def geometries(self) -> dict[int, Geometry]:
        """Return a `Geometry` for each number that ``geometry_ids`` may have."""
        streams = (stream for shard in self._manifest.shards for stream in shard.streams)
        return {s.number: Geometry(s.group, kind_of(s.number), s.objects) for s in streams}

    @property
    def camera(self) -> Camera | None:
        """Return the scene's own camera, or None."""
        return self._manifest.camera

    @property
    def colors(self) -> tuple[ColorScale, ...]:
        """Return what colors say that a map has made of numbers, as `Scene.colors`."""
        return self._wavefront.colors

    @property
    def lights(self) -> list[Light]:
        """Return the scene's own lights."""
        return list(self._manifest.lights)

    @property
    def background(self) -> tuple[float, float, float]:
        """Return the color of rays that meet nothing, linear RGB."""
        return self._manifest.background

    @property
    def workers(self) -> dict[str, tuple[int, ...]]:
        """Return the shards, by their places in the file, that each worker answers for."""
        return {each.workers[0]: each.numbers for each in self._wavefront.carriers}

    def preview(self, pixels: int = 256, camera: Camera | None = None) -> Image:
        """Render a small picture of the scene where its shards are, as `Scene.preview`."""
        view = preview_camera(self._wavefront.store, pixels, camera)
        return self.render(camera=view, depth=1)

    def turntable(self, count: int, camera: Camera | None = None) -> list[Camera]:
        """Return views around the scene, as `Scene.turntable`."""
        return turntable(self._wavefront.store, count, camera)

    @overload
    def render(
        self,
        *,
        memory: str | int | None = None,
        threads: int | None = None,
        camera: Camera | None = None,
        samples: int | None = None,
        depth: int = DEPTH,
        aovs: Sequence[str] = (),
        lights: Sequence[Light | Sun] | None = None,
        ambient: float | None = None,
        ao: int = 0,
        ao_distance: float | None = None,
        background: Vector | None = None,
        refine: str | None = None,
        fresh_marks: bool = False,
        grid: int | None = None,
        max_grid: int | None = None,
        scratch: PathLike | None = None,
        progress: bool | Report = False,
        checkpoint: PathLike | None = None,
    ) -> Image: ...
    @overload
    def render(
        self,
        *,
        memory: str | int | None = None,
        threads: int | None = None,
        camera: Sequence[Camera],
        samples: int | None = None,
        depth: int = DEPTH,
        aovs: Sequence[str] = (),
        lights: Sequence[Light | Sun] | None = None,
        ambient: float | None = None,
        ao: int = 0,
        ao_distance: float | None = None,
        background: Vector | None = None,
        refine: str | None = None,
        fresh_marks: bool = False,
        grid: int | None = None,
        max_grid: int | None = None,
        scratch: PathLike | None = None,
        progress: bool | Report = False,
        checkpoint: PathLike | None = None,
    ) -> Images: ...
    def render(
        self,
        *,
        memory: str | int | None = None,
        threads: int | None = None,
        camera: Cameras = None,
        samples: int | None = None,
        depth: int = DEPTH,
        aovs: Sequence[str] = (),
        lights: Sequence[Light | Sun] | None = None,
        ambient: float | None = None,
        ao: int = 0,
        ao_distance: float | None = None,
        background: Vector | None = None,
        refine: str | None = None,
        fresh_marks: bool = False,
        grid: int | None = None,
        max_grid: int | None = None,
        scratch: PathLike | None = None,
        progress: bool | Report = False,
        checkpoint: PathLike | None = None,
    ) -> Image | Images:
        """Render the scene where its shards are.

        Rays go to the workers whose shards' bounds they meet, and each hit is shaded by the worker
        that has its object. The picture is the same, bit for bit, as that of `Scene.render`.

        Parameters
        ----------
        memory, threads : optional
            Each worker's; by default a quarter of its limit, and all its threads. The client takes
            a quarter of what its machine has: a larger frame is rendered in bands of rows, and rays
            and hits beyond that wait on its disk, beside the scene's file.
        camera, samples, depth, aovs, lights, ambient, ao, ao_distance, background
            As for `Scene.render`.
        refine, fresh_marks, grid, max_grid
            As for `Scene.render`.
        scratch : path-like, optional
            A folder that each worker has; by default its own on its disk.
        progress : bool or callable
            As for `Scene.render`: it is told the rays of each depth, after each task.
        checkpoint : None
            One is refused: where a worker ends, others do its tasks again.

        Returns
        -------
        Image or Images
            As `Scene.render`. ``stats.travel`` counts what went between client and workers, by
            depth; ``stats.workers`` has the counters of each worker.

        Raises
        ------
        SettingError, BudgetError, StoreError, StreamError, DiskFullError, Cancelled
            As for `Scene.render`; those of a shard or of a budget name the worker.
        """
        if checkpoint is not None:
            raise SettingError(
                "checkpoint: found one for a scene on a cluster, expected None: where a worker "
                "ends, others do its tasks again"
            )
        light = LightAsked(lights, ambient, ao, ao_distance, background)
        views = Views.of(self._wavefront.store, camera, samples, depth, aovs, light)
        asked = cluster.Asked(
            memory, threads, refine or FINEST, grid, max_grid, fresh_marks, scratch
        )
        with reporting(progress) as report, in_memory(f"{self.path}: rendering"):
            return asked_for(self._wavefront.render(views, asked, refine, report), camera)

    def cast_rays(
        self,
        origins: queries.Given,
        directions: queries.Given | None = None,
        t_min: ArrayLike = 0.0,
        t_max: ArrayLike = np.inf,
        *,
        outputs: Sequence[str] = (),
        side: str = "incoming",
        out: queries.Out | None = None,
        progress: bool | Report = False,
        memory: str | int | None = None,
        threads: int | None = None,
        refine: str | None = None,
        grid: int | None = None,
        max_grid: int | None = None,
        scratch: PathLike | None = None,
    ) -> queries.Answer:
        """Find the nearest hit of each ray.

        Parameters
        ----------
        origins, directions, t_min, t_max, outputs, side, out, progress
            As for `Scene.cast_rays`; rays are arrays or files, since blocks do not tell how many.
        memory, threads : optional
            Each worker's; by default a quarter of its limit, and all its threads.
        refine, grid, max_grid, scratch
            As for `Scene.cast_rays`. `scratch` is a folder that each worker has; by default its own
            on its disk.

        Returns
        -------
        Answer
            As `Scene.cast_rays`. ``stats.travel`` counts what went between client and workers,
            ``stats.workers`` has the counters of each worker.

        Raises
        ------
        SettingError, BudgetError, StoreError, StreamError, DiskFullError, Cancelled
            As for `Scene.cast_rays`; those of a shard or of a budget name the worker.
        """
        asked = asked_of(memory, threads, refine, grid, max_grid, scratch)
        rays = (origins, directions, t_min, t_max, out)
        wanted = wavefront.nearest(queries.Extras.of(outputs, side))
        return self._answer(wanted, rays, progress, asked, refine)

    def occluded(
        self,
        origins: queries.Given,
        directions: queries.Given | None = None,
        t_min: ArrayLike = 0.0,
        t_max: ArrayLike = np.inf,
        *,
        out: queries.Out | None = None,
        progress: bool | Report = False,
        memory: str | int | None = None,
        threads: int | None = None,
        refine: str | None = None,
        grid: int | None = None,
        max_grid: int | None = None,
        scratch: PathLike | None = None,
    ) -> queries.Answer:
        """Find whether each ray hits anything in (t_min, t_max).

        Parameters
        ----------
        origins, directions, t_min, t_max, out, progress, memory, threads, refine, grid, max_grid
            As for `cast_rays`.
        scratch : path-like, optional
            As for `cast_rays`.

        Returns
        -------
        Answer
            ``occluded`` (n,) bool.

        Raises
        ------
        SettingError, BudgetError, StoreError, StreamError, DiskFullError, Cancelled
            As for `cast_rays`.
        """
        asked = asked_of(memory, threads, refine, grid, max_grid, scratch)
        rays = (origins, directions, t_min, t_max, out)
        return self._answer(wavefront.ANY, rays, progress, asked, refine)

    def count_intersections(
        self,
        origins: queries.Given,
        directions: queries.Given | None = None,
        t_min: ArrayLike = 0.0,
        t_max: ArrayLike = np.inf,
        *,
        out: queries.Out | None = None,
        progress: bool | Report = False,
        memory: str | int | None = None,
        threads: int | None = None,
        refine: str | None = None,
        grid: int | None = None,
        max_grid: int | None = None,
        scratch: PathLike | None = None,
    ) -> queries.Answer:
        """Count all hits of each ray in (t_min, t_max).

        Parameters
        ----------
        origins, directions, t_min, t_max, out, progress, memory, threads, refine, grid, max_grid
            As for `cast_rays`.
        scratch : path-like, optional
            As for `cast_rays`.

        Returns
        -------
        Answer
            ``counts`` (n,) int64.

        Raises
        ------
        SettingError, BudgetError, StoreError, StreamError, DiskFullError, Cancelled
            As for `cast_rays`.
        """
        asked = asked_of(memory, threads, refine, grid, max_grid, scratch)
        rays = (origins, directions, t_min, t_max, out)
        return self._answer(wavefront.COUNT, rays, progress, asked, refine)

    def list_intersections(
        self,
        origins: queries.Given,
        directions: queries.Given | None = None,
        t_min: ArrayLike = 0.0,
        t_max: ArrayLike = np.inf,
        *,
        out: queries.Out | None = None,
        progress: bool | Report = False,
        memory: str | int | None = None,
        threads: int | None = None,
        refine: str | None = None,
        grid: int | None = None,
        max_grid: int | None = None,
        scratch: PathLike | None = None,
    ) -> queries.Answer:
        """Find all hits of each ray in (t_min, t_max).

        Parameters
        ----------
        origins, directions, t_min, t_max, progress, memory, threads, refine, grid, max_grid
            As for `cast_rays`.
        out : path-like, optional
            A folder for the answer, as for `Scene.list_intersections`.
        scratch : path-like, optional
            As for `cast_rays`.

        Returns
        -------
        Answer
            As `Scene.list_intersections`.

        Raises
        ------
        SettingError, BudgetError, StoreError, StreamError, DiskFullError, Cancelled
            As for `cast_rays`.
        """
        asked = asked_of(memory, threads, refine, grid, max_grid, scratch)
        rays = (origins, directions, t_min, t_max, out)
        return self._answer(wavefront.ALL, rays, progress, asked, refine)

    def visibility(
        self,
        points: queries.Points,
        normals: queries.Points | None = None,
        rays: int = 64,
        distance: float = np.inf,
        *,
        cosine: bool = False,
        out: queries.Out | None = None,
        progress: bool | Report = False,
        memory: str | int | None = None,
        threads: int | None = None,
        refine: str | None = None,
        grid: int | None = None,
        max_grid: int | None = None,
        scratch: PathLike | None = None,
    ) -> queries.Answer:
        """Find which part of what is around each point is open: ambient occlusion, sky view.

        Parameters
        ----------
        points, normals, rays, distance, cosine, out, progress
            As for `Scene.visibility`; points are arrays or files.
        memory, threads, refine, grid, max_grid, scratch
            As for `cast_rays`.

        Returns
        -------
        Answer
            As `Scene.visibility`, with ``stats`` as of `cast_rays`.

        Raises
        ------
        SettingError, BudgetError, StoreError, StreamError, DiskFullError, Cancelled
            As for `Scene.visibility`; those of a shard or of a budget name the worker.
        """
        query = queries.visibility_of(
            rays, distance, around_normals=normals is not None, cosine=cosine
        )
        asked = asked_of(memory, threads, refine, grid, max_grid, scratch)
        with self._asking(progress) as report:
            question = queries.PointQuestion(points, normals, out, report)
            return self._wavefront.answer_points(query, question, asked, refine)

    def contains(
        self,
        points: queries.Points,
        *,
        out: queries.Out | None = None,
        progress: bool | Report = False,
        memory: str | int | None = None,
        threads: int | None = None,
        refine: str | None = None,
        grid: int | None = None,
        max_grid: int | None = None,
        scratch: PathLike | None = None,
    ) -> queries.Answer:
        """Find which points are inside of what is closed: meshes and spheres.

        Parameters
        ----------
        points, out, progress
            As for `Scene.contains`; points are arrays or files.
        memory, threads, refine, grid, max_grid, scratch
            As for `cast_rays`.

        Returns
        -------
        Answer
            As `Scene.contains`, with ``stats`` as of `cast_rays`.

        Raises
        ------
        SettingError, BudgetError, StoreError, StreamError, DiskFullError, Cancelled
            As for `Scene.contains`; those of a shard or of a budget name the worker.
        """
        asked = asked_of(memory, threads, refine, grid, max_grid, scratch)
        with self._asking(progress) as report:
            question = queries.PointQuestion(points, None, out, report)
            return self._wavefront.answer_points(queries.CONTAINS, question, asked, refine)

    def _answer(
        self,
        wanted: wavefront.Wanted,
        rays: queries.RaysGiven,
        progress: bool | Report,
        asked: cluster.Asked,
        refine: str | None,
    ) -> queries.Answer:
        with self._asking(progress) as report:
            question = queries.Question(*rays, report)
            return self._wavefront.answer(wanted, question, asked, refine)

    @contextmanager
    def _asking(self, progress: bool | Report) -> Iterator[Report]:
        """Yield what is told of a query's progress; name a lack of memory by what is done."""
        with reporting(progress) as report, in_memory(f"{self.path}: tracing rays"):
            yield report


def asked_of(
    memory: str | int | None, threads: int | None, refine: str | None, grid: int | None,
    max_grid: int | None, scratch: PathLike | None,
) -> cluster.Asked:  # fmt: skip
    """Return the settings of a query, which keeps the marks that are there."""
    return cluster.Asked(
        memory, threads, refine or FINEST, grid, max_grid, fresh_marks=False, scratch=scratch
    )


@overload
def open_scene(path: PathLike, *, client: None = None) -> Scene: ...
@overload
def open_scene(path: PathLike, *, client: Any) -> ShardedScene: ...
def open_scene(path: PathLike, *, client: Any = None) -> Scene | ShardedScene:
    """Open a scene: read its header and check the sizes of its files.

    Parameters
    ----------
    path : path-like
        The store, a folder that `SceneWriter` or `convert` made; or the file of a sharded scene,
        whose stores are opened as the groups of one scene.
    client : distributed.Client or True, optional
        Leave the shards of a sharded scene with the workers of a Dask cluster: only they open
        them, and rays go there. True is the current client.

    Returns
    -------
    Scene or ShardedScene
        It holds the header only; no object is read. With a client, it is a `ShardedScene`.

    Raises
    ------
    StoreError
        If it is no store, of another version, damaged or truncated, or a shard is; or if a shard
        is another store than the one that the scene was made with. With a client the message
        names a worker.
    StreamError
        If the system refuses to read it.
    SettingError
        If there is no such client, or the scene is not sharded.
    """
    return open_here(path) if client is None else ShardedScene(path, client)
