"""``bfrt.open``: an open scene, its renders and its ray queries."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass
from functools import update_wrapper
from inspect import signature
from pathlib import Path
from typing import Any, Concatenate, ParamSpec, TypeVar, overload

import numpy as np
from numpy.typing import ArrayLike, NDArray

from bfrt import cluster, planning, queries
from bfrt.budget import capacities
from bfrt.checkpoint.checkpoint import EVERY, Checkpoint, keeping
from bfrt.checkpoint.identity import identity_of, identity_of_render
from bfrt.checkpoint.soundness import QUERY_FACTS, RENDER_FACTS
from bfrt.errors import SettingError
from bfrt.framing import framing_camera as framing_camera_of
from bfrt.framing import turntable as turntable_of
from bfrt.grid.marks import verify_marks
from bfrt.illumination import LightAsked
from bfrt.image.color_scale import ColorScale
from bfrt.image.picture import Image
from bfrt.image.pictures import Images
from bfrt.notebook import html_of
from bfrt.progress import Report, reporting
from bfrt.records import Kind
from bfrt.refusals import in_memory
from bfrt.rendering import pictures_of
from bfrt.session import Divide, Session
from bfrt.settings import FINEST, TREE, Settings
from bfrt.shards.store import open_any
from bfrt.store.extent import Bounds
from bfrt.store.model import Camera, Light, Vector
from bfrt.store.store import Store
from bfrt.store.sun import Sun
from bfrt.tracing import tracer_of
from bfrt.view import DEPTH, Cameras, Views, asked_for, preview_camera

PathLike = str | os.PathLike[str]

#: A ``dask.distributed.Client``, True for the current one, or None for none.
Client = Any


@dataclass(frozen=True)
class Geometry:
    """Describes the objects of one kind in one group, which ``geometry_ids`` refer to.

    Attributes
    ----------
    group : int
        Number of the group, from 0.
    kind : Kind
        The kind of the objects.
    count : int
        Number of objects; ``primitive_ids`` are 0 to count - 1.
    """

    group: int
    kind: Kind
    count: int


class Scene:
    """Renders an open scene and answers ray queries; it holds the header, not the data.

    A scene is a context manager, and `bfrt.open` makes one. A query prepares threads, memory, open
    files and the grid, which the scene keeps until it is closed, rendered, or asked with other
    settings: a second query with the same settings prepares nothing again. A scene closes itself
    when nothing refers to it. Threads may share one: while a query runs, another query prepares for
    itself.

    Parameters
    ----------
    store : Store
        The open store.
    divide : callable
        Divides a memory budget among rays, grid and buffers, as `bfrt.budget.capacities` does.

    Attributes
    ----------
    store : Store
        The open store: groups, streams, files.
    """

    def __init__(self, store: Store, divide: Divide = capacities) -> None:
        self.store = store
        self._session = Session(store, divide)

    def __copy__(self) -> Scene:
        """Return a scene of the same store, which prepares for itself."""
        return Scene(self.store, self._session.divide)

    def __deepcopy__(self, _: object) -> Scene:
        return self.__copy__()

    def __reduce__(
        self,
    ) -> tuple[Callable[[cluster.Place, Divide], Scene], tuple[cluster.Place, Divide]]:
        """Reduce to the place of the store, which another process opens for itself."""
        return _sent, (cluster.Place.of(self.store), self._session.divide)

    def __repr__(self) -> str:
        return f"<Scene {str(self.path)!r}: {self.objects:,} objects>"

    def _repr_html_(self) -> str:
        return html_of(self.store)

    @property
    def path(self) -> Path:
        """Return the path of the store."""
        return self.store.path

    @property
    def objects(self) -> int:
        """Return the number of objects."""
        return self.store.objects

    @property
    def bytes(self) -> int:
        """Return the bytes on disk, without marks."""
        return self.store.bytes

    @property
    def origin(self) -> tuple[float, float, float]:
        """Return the point, in world coordinates, that the store's coordinates count from."""
        return self.store.origin

    @property
    def bounds(self) -> Bounds:
        """Return the box around all objects, world coordinates: ``lo`` and ``hi``, (3,) float64.

        A scene without objects has lo = inf and hi = -inf.
        """
        return self.store.world_bounds

    @property
    def geometries(self) -> dict[int, Geometry]:
        """Return a `Geometry` for each number that ``geometry_ids`` may have."""
        streams = self.store.streams
        return {s.number: Geometry(s.group, s.kind, s.count) for s in streams}

    @property
    def camera(self) -> Camera | None:
        """Return the scene's own camera, or None."""
        return self.store.camera

    @property
    def crs(self) -> str:
        """Return the reference system of coordinates, "EPSG:32632" or WKT; empty for none."""
        return self.store.crs

    @property
    def colors(self) -> tuple[ColorScale, ...]:
        """Return what colors say that a map has made of numbers: its name, its range."""
        return self.store.colors

    @property
    def lights(self) -> list[Light]:
        """Return the scene's own lights."""
        return self.store.lights

    @property
    def background(self) -> tuple[float, float, float]:
        """Return the color of rays that meet nothing, linear RGB."""
        return self.store.background

    def materials(self) -> NDArray[Any]:
        """Read the palette.

        Returns
        -------
        (materials,) structured ndarray
            Of `bfrt.records.MATERIAL`: float32 red, green, blue, kd, ks, shine, transmittance, ior.

        Raises
        ------
        StoreError
            If the palette is damaged.
        StreamError, ResourceError
            If the system refuses to read it, or has no memory for it.
        """
        with in_memory(f"{self.path}: reading the palette"):
            return self.store.materials()

    def verify(self) -> None:
        """Read every file of the store and compare checksums.

        Raises
        ------
        StoreError
            If a file differs from what was written, marks included; it names the first.
        StreamError, ResourceError
            If the system refuses to read a file, or has no memory for that.
        """
        with in_memory(f"{self.path}: verifying"):
            self.store.verify()
            for group in self.store.groups:
                verify_marks(self.store, group)

    def __enter__(self) -> Scene:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Release what queries have prepared: threads, memory, open files. May be repeated."""
        self._session.close()

    def _refinement(self, asked: str | None, *of_grid: int | bool | None) -> str:
        """Return the refinement asked for, or the one for this store and settings of a grid."""
        if asked == TREE and (ordering := planning.ordering_of(self.store)) is not None:
            raise SettingError(
                f"refine: found {TREE!r} for {self.path}, whose objects are in the order given, "
                "expected base, sg or sgb, or a store made with order='spatial', which takes "
                f"{ordering.disk} bytes of disk beside them for a while"
            )
        if asked is not None:
            return asked
        gridded = any(value is not None and value is not False for value in of_grid)
        return TREE if self.store.ordered and not gridded else FINEST

    def _inside(self, settings: Settings, doing: str) -> AbstractContextManager[None]:
        """Name a lack of memory in a block by what is done, and the budget."""
        return in_memory(f"{self.path}: {doing}", settings.memory)

    @contextmanager
    def _keeping(
        self,
        checkpoint: PathLike | Checkpoint | None,
        every: float,
        what: str,
        settings: Settings,
        out: queries.Out | None,
    ) -> Iterator[Checkpoint | None]:
        """Yield the checkpoint of a query, if one is asked for, with what it has found."""
        if checkpoint is not None and not isinstance(out, (str, os.PathLike)):
            raise SettingError(
                "checkpoint: found no folder for the answer, expected out=: what a query keeps is "
                "for answers that go to files"
            )
        with keeping(checkpoint, every) as kept:
            if kept is not None:
                kept.find(identity_of(what, self.store, settings), QUERY_FACTS)
            yield kept

    def framing_camera(
        self,
        *,
        eye: Vector | None = None,
        at: Vector | None = None,
        up: Vector = Camera.up,
        angle: float = Camera.angle,
        resolution: tuple[int, int] = Camera.resolution,
    ) -> Camera:
        """Return a camera that frames the scene from the front, a little to the right and above.

        The camera looks at the center of the bounds, from a distance of ``radius / sin(half)``: the
        radius is half the bounds' diagonal, and ``half`` is half the smaller of the vertical and
        the horizontal angle of view. So the sphere around the bounds touches all edges of a square
        picture, and two edges of any other.

        Parameters
        ----------
        eye, at : tuple of 3 float, optional
            Where the eye is and the point it looks at, world coordinates, instead of those that
            frame the scene.
        up : tuple of 3 float
            The direction that is up, of any length. The front is at right angles to it: -y if z is
            up, z if y is up.
        angle : float
            Vertical field of view, from the bottom to the top of the image, in degrees, in
            (0, 180).
        resolution : tuple of 2 int
            Width and height in pixels, 1 to 65535 each.

        Returns
        -------
        Camera

        Raises
        ------
        SettingError
            If there is nothing to frame, no objects or no extent; or if `up` is no direction.
        SceneError
            If a value is out of range, or eye, at and up do not span a view.
        """
        return framing_camera_of(
            self.store, eye=eye, at=at, up=up, angle=angle, resolution=resolution
        )

    def preview(self, pixels: int = 256, camera: Camera | None = None) -> Image:
        """Render a small picture of the scene, which a notebook shows: without mirrors.

        Parameters
        ----------
        pixels : int
            Of its longer side, 1 to 65535.
        camera : Camera, optional
            The view, whose other side follows. By default as of `render`.

        Returns
        -------
        Image

        Raises
        ------
        SettingError, BudgetError, StoreError, StreamError
            As for `render`.
        """
        return self.render(camera=preview_camera(self.store, pixels, camera), depth=1)

    def turntable(self, count: int, camera: Camera | None = None) -> list[Camera]:
        """Return views around the scene: a camera that is turned about the center of the bounds.

        The axis has the camera's up direction; from above the camera goes round against the clock.

        Parameters
        ----------
        count : int
            Views of a whole turn, 1 to 65536.
        camera : Camera, optional
            The first of them. By default as of `render`.

        Returns
        -------
        list of Camera

        Raises
        ------
        SettingError
            If `count` is no such number, or there is no camera, and no object to frame.
        """
        return turntable_of(self.store, count, camera)

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
        checkpoint: PathLike | Checkpoint | None = None,
        every: float = EVERY,
        client: Client = None,
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
        checkpoint: PathLike | Checkpoint | None = None,
        every: float = EVERY,
        client: Client = None,
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
        checkpoint: PathLike | Checkpoint | None = None,
        every: float = EVERY,
        client: Client = None,
    ) -> Image | Images:
        """Render the scene, from one view or from several at once.

        The picture is the same, bit for bit, for every memory budget and every number of threads.

        Parameters
        ----------
        memory : str or int, optional
            The budget of the whole process: ``"256MiB"`` or bytes. By default a quarter of the
            machine's memory, or of its cgroup's limit.
        threads : int, optional
            Number of threads. By default all cores that this process may use.
        camera : Camera or sequence of Camera, optional
            The view. By default the scene's own, or if it has none one that frames it
            (`framing_camera`). Several views, of one resolution, share all passes over the scene,
            and each picture is the same as alone, bit for bit (`turntable` makes some).
        samples : int, optional
            Stratified samples a pixel. By default SPD's procedure: a ray at each pixel corner, four
            averaged.
        depth : int
            Hits shaded along a path, the eye ray's included; 1 or more.
        aovs : sequence of {"position", "albedo"}
            Channels that the image has beside those that it always has, of each pixel's first
            sample: P.X P.Y P.Z, world coordinates, inf on a miss; albedo.R albedo.G albedo.B, the
            material's color, 0 on a miss. Each takes 12 bytes a pixel, twice while the frame is in
            memory.
        lights : sequence of Light and Sun, optional
            The lights, in place of the scene's own and of those that a scene without any gets;
            ``[*scene.lights, Sun(315, 45)]`` keeps its own. Without any there is ambient light
            alone.
        ambient : float, optional
            Intensity of the ambient light, 0 or more, which a surface has in ``kd`` times its
            color. By default that of each of n lights, sqrt(n) / (2 n), and 1 without lights.
        ao : int
            Ambient occlusion: that many rays from each eye hit, 65536 at the most, find out from
            how much of the hemisphere ambient light comes. What is seen by mirrors and through
            glass sends a part of them, as large as the part that it is seen by. 0 is none.
        ao_distance : float, optional
            How far these rays go, world units: one that meets nothing until there lets the light
            come. By default through all of the scene.
        background : tuple of 3 float, optional
            The color of rays that meet nothing, linear RGB. By default the scene's.
        refine : {"tree", "sgb", "sg", "base"}, optional
            ``tree``: rays go through treelets, in place of a grid; for stores in spatial order,
            where it is the default unless something of a grid is asked for. The paper's
            refinements, for all stores: ``base`` reads every box and all geometry wherever the
            original algorithm does; ``sg`` reads geometry only where a ray meets its box, or hits
            it; ``sgb``, the default of other stores, also skips boxes that the hierarchy shows to
            be far from all rays. The picture is the same.
        fresh_marks : bool
            Make the voxel marks again, instead of using those in the store.
        grid : int, optional
            Voxels on the longest axis of each grid. By default there are about as many voxels as
            objects, as far as memory goes.
        max_grid : int, optional
            The most voxels on the longest axis.
        scratch : path-like, optional
            Folder for temporary files, and for marks if the store is read-only. By default the
            store's parent, or the system's temporary folder if the parent is read-only.
        progress : bool or callable
            True shows a bar (needs tqdm, and a terminal). A callable gets a `Progress` first
            and after each pass; returning False cancels.
        checkpoint : path-like, optional
            Folder that keeps the state of the render while it goes on, so that the same call goes
            on from there after a kill; it is removed at the end. What changes the picture must be
            as it was, and `refine`; memory, threads and the grid may change. Of an open
            `bfrt.checkpoint.checkpoint.Checkpoint` the caller removes the state.
        every : float
            Seconds between two saves of that state at the least; they take no more than 2 % of the
            time. 0 saves after each pass, whatever that takes.
        client : dask.distributed.Client, or True, optional
            The workers of a cluster render some rows each; True is the current client. The
            store has the same path on all of them. `memory`, `threads` and `scratch` are each
            worker's: by default a quarter of its memory limit, and all its threads. A checkpoint
            is refused. `progress` gets the sum of all rows and depths. By default this process
            renders.

        Returns
        -------
        Image or Images
            R G B A, Z, N and object ids, and the `aovs`; `Image.stats` has the counters. Where
            `camera` is a sequence, a list of the picture of each.

        Raises
        ------
        StoreError
            If the store is damaged.
        BudgetError
            If the budget is below the least that works, which the message names.
        SettingError
            If a setting cannot be honoured, or there is no camera, and no object to frame.
        Cancelled
            If `progress` returned False.
        CheckpointError
            If the state in `checkpoint` is damaged. That of other work is a SettingError.
        DiskFullError, StreamError
            If the system refuses a read or a write.
        """
        light = LightAsked(lights, ambient, ao, ao_distance, background)
        views = Views.of(self.store, camera, samples, depth, aovs, light)
        refine = self._refinement(refine, grid, max_grid, fresh_marks)
        if client is not None and client is not False:
            asked = cluster.Asked(memory, threads, refine, grid, max_grid, fresh_marks, scratch)
            return asked_for(self._render_by(client, views, asked, progress, checkpoint), camera)
        settings = Settings.of(memory, threads, refine, grid, max_grid, fresh_marks, scratch)
        reported, inside = reporting(progress), self._inside(settings, "rendering")
        with reported as report, inside, keeping(checkpoint, every) as kept:
            frame = views.frame
            if kept is not None:
                work = identity_of_render(self.store, views, settings)
                found = kept.find(work, RENDER_FACTS)
                frame = frame._replace(band=0 if found is None else found.facts["rows"])
            plan = self._session.divide(self.store, settings, frame)
            self._session.make_room()
            folder = None if kept is None else kept.folder
            with (
                self.store.folder.session(),
                tracer_of(self.store, settings, plan, folder) as tracer,
            ):
                return asked_for(pictures_of(tracer, views, report, kept), camera)

    def _render_by(
        self,
        client: Client,
        views: Views,
        asked: cluster.Asked,
        progress: bool | Report,
        checkpoint: PathLike | Checkpoint | None,
    ) -> Images:
        """Render by the workers of a cluster."""
        if checkpoint is not None:
            raise SettingError(
                "checkpoint: found one with a client, expected None: parts that are finished are "
                "kept by the cluster, and only a worker's own are done again"
            )
        with reporting(progress) as report, in_memory(f"{self.path}: rendering"):
            heard = None if progress is False else report
            return cluster.render_shared(cluster.client_of(client), self.store, views, asked, heard)

    def plan(
        self,
        *,
        memory: str | int | None = None,
        threads: int | None = None,
        camera: Cameras = None,
        resolution: tuple[int, int] | None = None,
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
        checkpoint: PathLike | None = None,
    ) -> planning.Plan:
        """Estimate the passes, bytes and seconds of a render, without reading any object.

        Parameters
        ----------
        resolution : tuple of 2 int, optional
            Width and height in pixels, 1 to 65535 each, instead of the camera's.
        memory, threads, camera, samples, depth, aovs, lights, ambient, ao, ao_distance, background
            As for `render`.
        refine, fresh_marks, grid, max_grid, scratch
            As for `render`.
        checkpoint : path-like, optional
            As for `render`; here it only adds its bytes on disk.

        Returns
        -------
        Plan
            ``print`` shows it as tables; `Plan.as_dict` is for JSON.

        Raises
        ------
        StoreError, BudgetError, SettingError
            As for `render`.
        """
        light = LightAsked(lights, ambient, ao, ao_distance, background)
        views = Views.of(self.store, camera, samples, depth, aovs, light).sized(resolution)
        refine = self._refinement(refine, grid, max_grid, fresh_marks)
        settings = Settings.of(memory, threads, refine, grid, max_grid, fresh_marks, scratch)
        held = self._session.divide(self.store, settings, views.frame)
        return planning.plan_of(self.store, views, settings, held, kept=checkpoint is not None)

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
        fresh_marks: bool = False,
        scratch: PathLike | None = None,
        checkpoint: PathLike | Checkpoint | None = None,
        every: float = EVERY,
    ) -> queries.Answer:
        """Find the nearest hit of each ray.

        Parameters
        ----------
        origins, directions : (n, 3) array_like, or path-like of an .npy file
            Float32, float64 or whole numbers of any byte order, in world coordinates; directions of
            any length but zero. Another leading shape, as (h, w, 3), is that of the answer too, and
            one of them may be (3,), for all. Memory maps and files may be larger than memory.
            Without directions, `origins` are rays of six numbers, (n, 6), or an iterable of blocks,
            pairs of arrays or such rays. Where any is a dask array, so are those of the answer, a
            `LazyAnswer`: a block of rays is a task.
        t_min, t_max : float or (n,) array_like
            Hits count in (t_min, t_max), in lengths of the direction. A ray with a t_min begins at
            ``origin + t_min * direction``, computed in float64.
        outputs : sequence of {"positions", "next_origins"}
            Keys that the answer has beside those that it always has.
        side : {"incoming", "opposite", "front", "back"}
            Where ``next_origins`` are: on the side that the ray came from, for reflections and
            shadows; on the other one, for what goes through; on that of the object's normal, or
            behind it.
        out : mapping of arrays, or path-like, optional
            Arrays to fill, by the keys of the answer; or a folder that gets a file ``KEY.npy`` for
            each key, in which case the answer is memory maps of these.
        progress : bool or callable
            As for `render`.
        memory : str or int, optional
            The budget of the whole process, as for `render`. The arrays of rays and of the answer
            are no part of it.
        threads, refine, grid, max_grid, fresh_marks, scratch
            As for `render`.
        checkpoint, every
            As for `render`, for answers that go to a folder: `out` must be one. The rays must be as
            they were.

        Returns
        -------
        Answer
            ``t_hit`` (n,) float64, inf for a miss; ``geometry_ids`` (n,) int32, which `geometries`
            explains, and ``primitive_ids`` (n,) int64, the object's place among its kind, both -1
            for a miss; ``primitive_normals`` (n, 3) float32, unit and geometric, 0 for a miss;
            ``primitive_uvs`` (n, 2) float32, barycentric in triangles and patches, else 0.
            ``positions`` (n, 3) float64, the places of the hits in world coordinates, and
            ``next_origins`` (n, 3) float64, these moved off the surface by the hit's error: a ray
            that begins there, and goes away from the surface on that side, does not meet it again
            there. Both are inf for a miss.

        Raises
        ------
        SettingError
            If rays have other shapes or dtypes, or a setting cannot be honoured.
        BudgetError, StoreError, StreamError, DiskFullError, Cancelled, CheckpointError
            As for `render`.

        Notes
        -----
        Among hits at the same t the object with the least id counts. The answer is the same, bit
        for bit, for every memory budget, number of threads and refinement.
        """
        refine = self._refinement(refine, grid, max_grid, fresh_marks)
        extras = queries.Extras.of(outputs, side)
        if cluster.is_lazy(origins, directions, t_min, t_max):
            local = cluster.Local(out, progress, checkpoint)
            rays = (origins, directions, t_min, t_max)
            asked = cluster.Asked(memory, threads, refine, grid, max_grid, fresh_marks, scratch)
            return cluster.ask_in_blocks("cast_rays", self.store, rays, asked, local, extras)
        settings = Settings.of(memory, threads, refine, grid, max_grid, fresh_marks, scratch)
        work = self._keeping(checkpoint, every, "cast_rays", settings, out)
        inside = self._inside(settings, "tracing rays")
        with reporting(progress) as report, inside, work as kept:
            question = queries.Question(origins, directions, t_min, t_max, out, report, kept)
            return queries.nearest(extras).answer(self._session.tracer, question, settings)

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
        fresh_marks: bool = False,
        scratch: PathLike | None = None,
        checkpoint: PathLike | Checkpoint | None = None,
        every: float = EVERY,
    ) -> queries.Answer:
        """Find whether each ray hits anything in (t_min, t_max).

        For the way from a to b give directions ``b - a`` and t_max 1, or a little less if b is on a
        surface.

        Parameters
        ----------
        origins, directions : (n, 3) array_like, or path-like of an .npy file
            Float32, float64 or whole numbers of any byte order, in world coordinates; directions of
            any length but zero. Another leading shape, as (h, w, 3), is that of the answer too, and
            one of them may be (3,), for all. Memory maps and files may be larger than memory.
            Without directions, `origins` are rays of six numbers, (n, 6), or an iterable of blocks,
            pairs of arrays or such rays. Where any is a dask array, so are those of the answer, a
            `LazyAnswer`: a block of rays is a task.
        t_min, t_max : float or (n,) array_like
            Hits count in (t_min, t_max), in lengths of the direction. A ray with a t_min begins at
            ``origin + t_min * direction``, computed in float64.
        out : mapping of arrays, or path-like, optional
            Arrays to fill, by the keys of the answer; or a folder that gets a file ``KEY.npy`` for
            each key, in which case the answer is memory maps of these.
        progress : bool or callable
            As for `render`.
        memory : str or int, optional
            The budget of the whole process, as for `render`. The arrays of rays and of the answer
            are no part of it.
        threads, refine, grid, max_grid, fresh_marks, scratch
            As for `render`.
        checkpoint, every
            As for `render`, for answers that go to a folder: `out` must be one. The rays must be as
            they were.

        Returns
        -------
        Answer
            ``occluded`` (n,) bool.

        Raises
        ------
        SettingError
            If rays have other shapes or dtypes, or a setting cannot be honoured.
        BudgetError, StoreError, StreamError, DiskFullError, Cancelled, CheckpointError
            As for `render`.
        """
        refine = self._refinement(refine, grid, max_grid, fresh_marks)
        if cluster.is_lazy(origins, directions, t_min, t_max):
            local = cluster.Local(out, progress, checkpoint)
            rays = (origins, directions, t_min, t_max)
            asked = cluster.Asked(memory, threads, refine, grid, max_grid, fresh_marks, scratch)
            return cluster.ask_in_blocks("occluded", self.store, rays, asked, local)
        settings = Settings.of(memory, threads, refine, grid, max_grid, fresh_marks, scratch)
        work = self._keeping(checkpoint, every, "occluded", settings, out)
        inside = self._inside(settings, "tracing rays")
        with reporting(progress) as report, inside, work as kept:
            question = queries.Question(origins, directions, t_min, t_max, out, report, kept)
            return queries.ANY_HIT.answer(self._session.tracer, question, settings)

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
        fresh_marks: bool = False,
        scratch: PathLike | None = None,
        checkpoint: PathLike | Checkpoint | None = None,
        every: float = EVERY,
    ) -> queries.Answer:
        """Count all hits of each ray in (t_min, t_max).

        A sphere or cone that is crossed twice counts twice; one that is touched counts once. A hit
        on an edge or a corner that faces share counts for one of them.

        Parameters
        ----------
        origins, directions : (n, 3) array_like, or path-like of an .npy file
            Float32, float64 or whole numbers of any byte order, in world coordinates; directions of
            any length but zero. Another leading shape, as (h, w, 3), is that of the answer too, and
            one of them may be (3,), for all. Memory maps and files may be larger than memory.
            Without directions, `origins` are rays of six numbers, (n, 6), or an iterable of blocks,
            pairs of arrays or such rays. Where any is a dask array, so are those of the answer, a
            `LazyAnswer`: a block of rays is a task.
        t_min, t_max : float or (n,) array_like
            Hits count in (t_min, t_max), in lengths of the direction. A ray with a t_min begins at
            ``origin + t_min * direction``, computed in float64.
        out : mapping of arrays, or path-like, optional
            Arrays to fill, by the keys of the answer; or a folder that gets a file ``KEY.npy`` for
            each key, in which case the answer is memory maps of these.
        progress : bool or callable
            As for `render`.
        memory : str or int, optional
            The budget of the whole process, as for `render`. The arrays of rays and of the answer
            are no part of it.
        threads, refine, grid, max_grid, fresh_marks, scratch
            As for `render`.
        checkpoint, every
            As for `render`, for answers that go to a folder: `out` must be one. The rays must be as
            they were.

        Returns
        -------
        Answer
            ``counts`` (n,) int64.

        Raises
        ------
        SettingError
            If rays have other shapes or dtypes, or a setting cannot be honoured.
        BudgetError, StoreError, StreamError, DiskFullError, Cancelled, CheckpointError
            As for `render`.
        """
        refine = self._refinement(refine, grid, max_grid, fresh_marks)
        if cluster.is_lazy(origins, directions, t_min, t_max):
            local = cluster.Local(out, progress, checkpoint)
            rays = (origins, directions, t_min, t_max)
            asked = cluster.Asked(memory, threads, refine, grid, max_grid, fresh_marks, scratch)
            return cluster.ask_in_blocks("count_intersections", self.store, rays, asked, local)
        settings = Settings.of(memory, threads, refine, grid, max_grid, fresh_marks, scratch)
        work = self._keeping(checkpoint, every, "count_intersections", settings, out)
        inside = self._inside(settings, "tracing rays")
        with reporting(progress) as report, inside, work as kept:
            question = queries.Question(origins, directions, t_min, t_max, out, report, kept)
            return queries.COUNT.answer(self._session.tracer, question, settings)

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
        fresh_marks: bool = False,
        scratch: PathLike | None = None,
        checkpoint: PathLike | Checkpoint | None = None,
        every: float = EVERY,
    ) -> queries.Answer:
        """Find all hits of each ray in (t_min, t_max).

        Parameters
        ----------
        origins, directions : (n, 3) array_like, or path-like of an .npy file
            Float32, float64 or whole numbers of any byte order, in world coordinates; directions of
            any length but zero. They may have another leading shape, as (h, w, 3), and
            one of them may be (3,), for all. Memory maps and files may be larger than memory.
            Without directions, `origins` are rays of six numbers, (n, 6), or an iterable of blocks,
            pairs of arrays or such rays. Where any is a dask array, so are those of the answer, a
            `LazyAnswer`: a block of rays is a task.
        t_min, t_max : float or (n,) array_like
            Hits count in (t_min, t_max), in lengths of the direction. A ray with a t_min begins at
            ``origin + t_min * direction``, computed in float64.
        out : path-like, optional
            A folder that gets a file ``KEY.npy`` for each key; the answer is memory maps of these.
            Arrays are refused, since the number of hits is not known before.
        progress : bool or callable
            As for `render`.
        memory : str or int, optional
            The budget of the whole process, as for `render`. The arrays of rays and of the answer
            are no part of it.
        threads, refine, grid, max_grid, fresh_marks, scratch
            As for `render`.
        checkpoint, every
            As for `render`, for answers that go to a folder: `out` must be one. The rays must be as
            they were.

        Returns
        -------
        Answer
            ``ray_splits`` (n + 1,) int64: ray i, in C's order, has the rows [ray_splits[i],
            ray_splits[i + 1]) of the other arrays, which are ordered by ray, then t, then id:
            ``ray_ids`` (m,) int64, and the arrays of `cast_rays`, with m rows.

        Raises
        ------
        SettingError
            If rays have other shapes or dtypes, or a setting cannot be honoured.
        BudgetError, StoreError, StreamError, DiskFullError, Cancelled, CheckpointError
            As for `render`.
        """
        refine = self._refinement(refine, grid, max_grid, fresh_marks)
        if cluster.is_lazy(origins, directions, t_min, t_max):
            local = cluster.Local(out, progress, checkpoint)
            rays = (origins, directions, t_min, t_max)
            asked = cluster.Asked(memory, threads, refine, grid, max_grid, fresh_marks, scratch)
            return cluster.ask_in_blocks("list_intersections", self.store, rays, asked, local)
        settings = Settings.of(memory, threads, refine, grid, max_grid, fresh_marks, scratch)
        work = self._keeping(checkpoint, every, "list_intersections", settings, out)
        inside = self._inside(settings, "tracing rays")
        with reporting(progress) as report, inside, work as kept:
            question = queries.Question(origins, directions, t_min, t_max, out, report, kept)
            return queries.LIST.answer(self._session.tracer, question, settings)

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
        fresh_marks: bool = False,
        scratch: PathLike | None = None,
        checkpoint: PathLike | Checkpoint | None = None,
        every: float = EVERY,
    ) -> queries.Answer:
        """Find which part of what is around each point is open: ambient occlusion, sky view.

        Parameters
        ----------
        points : (n, 3) array_like, or path-like of an .npy file
            As origins of `cast_rays`: of any leading shape, in world coordinates, larger than
            memory if they are mapped or a file. Where any is a dask array, so is the answer.
        normals : array_like or path-like, as points, optional
            Of any length but zero, one for each point or (3,) for all. Rays go to the hemisphere
            around each, and begin off the surface by the error that a hit there has. Without
            normals rays go to all sides, and begin at the points.
        rays : int
            From each point, 1 to 65536.
        distance : float
            How far what hides may be, world units. Above 0.
        cosine : bool
            Whether directions count by their cosine with the normal, as in MeshLab's ambient
            occlusion, and as light from there does; by default all count alike, as in
            CloudCompare's PCV.
        out : mapping of arrays, or path-like, optional
            Arrays to fill, by the keys of the answer; or a folder that gets a file ``KEY.npy`` for
            each key, in which case the answer is memory maps of these.
        progress : bool or callable
            As for `render`; it is told rays.
        memory : str or int, optional
            The budget of the whole process, as for `render`. The arrays of points and of the answer
            are no part of it.
        threads, refine, grid, max_grid, fresh_marks, scratch
            As for `render`.
        checkpoint, every
            As for `render`, for answers that go to a folder: `out` must be one. The points must be
            as they were.

        Returns
        -------
        Answer
            ``visibility`` (n,) float32, from 0, where all rays meet something, to 1; NaN where a
            point or a normal is no number, or a normal has no length.

        Raises
        ------
        SettingError
            If points have other shapes or dtypes, or a setting cannot be honoured.
        BudgetError, StoreError, StreamError, DiskFullError, Cancelled, CheckpointError
            As for `render`.

        Notes
        -----
        Directions are a Fibonacci lattice, turned by a hash of the point's number. The answer is
        the same, bit for bit, for every memory budget, number of threads and refinement.
        """
        refine = self._refinement(refine, grid, max_grid, fresh_marks)
        query = queries.visibility_of(
            rays, distance, around_normals=normals is not None, cosine=cosine
        )
        if cluster.is_lazy(points, normals):
            local = cluster.Local(out, progress, checkpoint)
            asked = cluster.Asked(memory, threads, refine, grid, max_grid, fresh_marks, scratch)
            return cluster.ask_about_points(query, self.store, (points, normals), asked, local)
        settings = Settings.of(memory, threads, refine, grid, max_grid, fresh_marks, scratch)
        work = self._keeping(checkpoint, every, "visibility", settings, out)
        inside = self._inside(settings, "tracing rays")
        with reporting(progress) as report, inside, work as kept:
            question = queries.PointQuestion(points, normals, out, report, kept)
            return query.answer(self._session.tracer, question, settings)

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
        fresh_marks: bool = False,
        scratch: PathLike | None = None,
        checkpoint: PathLike | Checkpoint | None = None,
        every: float = EVERY,
    ) -> queries.Answer:
        """Find which points are inside of what is closed: meshes and spheres.

        A point is inside if a ray from it crosses surfaces an odd number of times; two rays are
        asked, in almost opposite directions.

        Parameters
        ----------
        points : (n, 3) array_like, or path-like of an .npy file
            As for `visibility`.
        out, progress, memory, threads, refine, grid, max_grid, fresh_marks, scratch
            As for `visibility`.
        checkpoint, every
            As for `visibility`.

        Returns
        -------
        Answer
            ``inside`` (n,) int8: 1 inside, 0 outside, and -1 where the two rays disagree, since
            something there is open, or the point is no number; ``stats.unsure_points`` counts
            these, and a warning tells how many they are.

        Raises
        ------
        SettingError
            If points have other shapes or dtypes, or a setting cannot be honoured.
        BudgetError, StoreError, StreamError, DiskFullError, Cancelled, CheckpointError
            As for `render`.

        Notes
        -----
        What is inside of two closed surfaces is outside again: a cavity is one in another. Cones
        and cylinders are open at their ends. The answer is the same, bit for bit, for every memory
        budget, number of threads and refinement.
        """
        refine = self._refinement(refine, grid, max_grid, fresh_marks)
        if cluster.is_lazy(points):
            local = cluster.Local(out, progress, checkpoint)
            asked = cluster.Asked(memory, threads, refine, grid, max_grid, fresh_marks, scratch)
            return cluster.ask_about_points(
                queries.CONTAINS, self.store, (points, None), asked, local
            )
        settings = Settings.of(memory, threads, refine, grid, max_grid, fresh_marks, scratch)
        work = self._keeping(checkpoint, every, "contains", settings, out)
        inside = self._inside(settings, "tracing rays")
        with reporting(progress) as report, inside, work as kept:
            question = queries.PointQuestion(points, None, out, report, kept)
            return queries.CONTAINS.answer(self._session.tracer, question, settings)


def open_scene(path: PathLike) -> Scene:
    """Open a scene: read its header and check the sizes of its files.

    Parameters
    ----------
    path : path-like
        The store, a folder that `SceneWriter` or `convert` made; or the file of a sharded scene,
        whose stores are opened as the groups of one scene.

    Returns
    -------
    Scene
        It holds the header only; no object is read.

    Raises
    ------
    StoreError
        If it is no store, of another version, damaged or truncated, or a shard is; or if a shard
        is another store than the one that the scene was made with.
    StreamError
        If the system refuses to read it.
    """
    with in_memory(f"{path}: opening"):
        return Scene(open_any(path))


def _sent(place: cluster.Place, divide: Divide) -> Scene:
    """Open a scene that another process has sent."""
    return Scene(place.open(), divide)


Passed = ParamSpec("Passed")
Told = TypeVar("Told")


def of_scene(
    method: Callable[Concatenate[Scene, Passed], Told],
) -> Callable[Concatenate[Scene | PathLike, Passed], Told]:
    """Make a method of `Scene` a function, whose first argument is a scene or a store's path."""

    def function(scene: Scene | PathLike, *args: Passed.args, **settings: Passed.kwargs) -> Told:
        if isinstance(scene, Scene):
            return method(scene, *args, **settings)
        with open_scene(scene) as opened:
            return method(opened, *args, **settings)

    update_wrapper(function, method).__qualname__ = method.__name__
    given = signature(method)
    first, *others = given.parameters.values()
    shown = given.replace(parameters=[first.replace(name="scene"), *others])
    vars(function)["__signature__"] = shown
    return function  # type: ignore[return-value]  # it takes its first argument by name too


framing_camera = of_scene(Scene.framing_camera)
turntable = of_scene(Scene.turntable)
render = of_scene(Scene.render)
plan = of_scene(Scene.plan)
cast_rays = of_scene(Scene.cast_rays)
occluded = of_scene(Scene.occluded)
count_intersections = of_scene(Scene.count_intersections)
list_intersections = of_scene(Scene.list_intersections)
visibility = of_scene(Scene.visibility)
contains = of_scene(Scene.contains)
