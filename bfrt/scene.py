"""``bfrt.open``: a scene, and what can be done with it."""

from __future__ import annotations

import os
import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import update_wrapper
from inspect import signature
from pathlib import Path
from typing import Any, Concatenate, ParamSpec, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from bfrt.budget import NO_FRAME, Capacities, capacities
from bfrt.framing import framing_camera as framing_camera_of
from bfrt.grid.marks import verify_marks
from bfrt.image.frame import FrameSize
from bfrt.image.picture import Image
from bfrt.planned import Plan
from bfrt.planning import plan_of
from bfrt.progress import Report, reporting
from bfrt.queries import casting
from bfrt.queries.answers import Out
from bfrt.queries.casting import Answer, Question
from bfrt.queries.rays import Given
from bfrt.records import Kind
from bfrt.rendering import picture_of
from bfrt.settings import FINEST, Settings
from bfrt.store.extent import Bounds
from bfrt.store.model import Camera, Light, Vector
from bfrt.store.store import Store, open_store
from bfrt.store.writer import StoreWriter
from bfrt.tracer import Tracer
from bfrt.view import DEPTH, View

PathLike = str | os.PathLike[str]

#: Divides the budget of settings, for a scene and a frame.
Divide = Callable[[Store, Settings, FrameSize], Capacities]


@dataclass(frozen=True)
class Geometry:
    """Describes the objects of one kind in one group, which ``geometry_ids`` refer to.

    Attributes
    ----------
    group : int
    kind : Kind
    count : int
        Objects; ``primitive_ids`` are less than that.
    """

    group: int
    kind: Kind
    count: int


class Scene:
    """Renders an open scene and answers ray queries; it holds the header, not the data.

    It is a context manager. What a query prepares (threads, memory, open files, the grid) is kept
    until the scene is closed, or asked with other settings: a second query of the same settings
    makes nothing again. A scene that is not closed is so when it is forgotten. Threads may share
    one: while a query is worked on, another prepares for itself.

    Parameters
    ----------
    store : Store
        The open store.
    divide : callable
        Divides a budget: `bfrt.budget.capacities`, or what gives less.

    Attributes
    ----------
    store : Store
        Its inside: groups, streams, files.
    """

    _kept: Tracer | None = None

    def __init__(self, store: Store, divide: Divide = capacities) -> None:
        self.store = store
        self._divide = divide
        # A query may be asked, and the scene closed, by what a query calls: blocks, progress.
        self._busy = threading.RLock()

    def __reduce__(self) -> tuple[type[Scene], tuple[Store, Divide]]:
        """Reduce to the store: copies, and what another process is sent, prepare for themselves."""
        return Scene, (self.store, self._divide)

    def __repr__(self) -> str:
        return f"<Scene {str(self.path)!r}: {self.objects:,} objects>"

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

        Of a scene without objects lo is inf and hi is -inf.
        """
        return self.store.world_bounds

    @property
    def geometries(self) -> dict[int, Geometry]:
        """Return what each of the ``geometry_ids`` refers to."""
        streams = self.store.streams
        return {s.number: Geometry(s.group, s.kind, s.count) for s in streams}

    @property
    def camera(self) -> Camera | None:
        """Return the scene's own camera, or None."""
        return self.store.camera

    @property
    def lights(self) -> list[Light]:
        """Return the scene's own lights."""
        return self.store.lights

    @property
    def background(self) -> tuple[float, float, float]:
        """Return the color of rays that meet nothing, linear RGB."""
        return self.store.background

    def materials(self) -> NDArray[Any]:
        """Read the palette, (materials,) of records.MATERIAL.

        Raises
        ------
        StoreError, StreamError
            If it is damaged, or as the system refuses.
        """
        return self.store.materials()

    def verify(self) -> None:
        """Read every file of the store and compare checksums.

        Raises
        ------
        StoreError
            For the first file that differs from what was written, marks included.
        """
        self.store.verify()
        for group in self.store.groups:
            verify_marks(self.store, group)

    def __enter__(self) -> Scene:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Give back what queries have prepared: threads, memory, open files."""
        with self._busy:
            self._forget()

    def __del__(self) -> None:
        self._forget()

    def _forget(self) -> None:
        kept, self._kept = self._kept, None
        if kept is not None:
            kept.close()

    def _make_room(self) -> None:
        """Give back what is kept, which would be beside a render's budget, unless it is in use."""
        if self._busy.acquire(blocking=False):
            try:
                self._forget()
            finally:
                self._busy.release()

    def _tracer(self, settings: Settings) -> Tracer:
        return Tracer(self.store, settings, self._divide(self.store, settings, NO_FRAME))

    @contextmanager
    def _session(self, settings: Settings) -> Iterator[Tracer]:
        """Yield a tracer of these settings: the kept one where it fits and is free.

        One that was broken off is not kept, and neither is one whose marks had to be fresh.
        """
        if not self._busy.acquire(blocking=False):
            with self._tracer(settings) as other:
                yield other
            return
        try:
            if self._kept is None or not self._kept.serves(settings):
                self._forget()
                self._kept = self._tracer(settings)
            tracer, self._kept = self._kept, None
            try:
                yield tracer
            except BaseException:
                tracer.close()
                raise
            if settings.fresh_marks:
                tracer.close()
            else:
                self._forget()
                self._kept = tracer
        finally:
            self._busy.release()

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

        It looks at the center of the bounds, from a distance of ``radius / sin(half)``: the radius
        is half the bounds' diagonal, ``half`` half the smaller of the vertical and the horizontal
        angle of view. So the sphere around the bounds touches the edges of the picture, or two of
        them.

        Parameters
        ----------
        eye, at : tuple of 3 float, optional
            Where the eye is and what it looks at, in place of what frames the scene.
        up : tuple of 3 float
            Which way is up. The front is at right angles to it: -y where z is up, z where y is.
        angle : float
            Field of view in degrees from the bottom to the top of the image, in (0, 180).
        resolution : tuple of 2 int
            Width and height in pixels; where it is higher than it is wide, the width has to fit.

        Returns
        -------
        Camera

        Raises
        ------
        SettingError
            If there is nothing to frame: no objects, or no extent; if `up` is no direction.
        SceneError
            As of `Camera`, if a value is out of range or what is given does not span a view.
        """
        return framing_camera_of(
            self.store, eye=eye, at=at, up=up, angle=angle, resolution=resolution
        )

    def render(
        self,
        *,
        memory: str | int | None = None,
        threads: int | None = None,
        camera: Camera | None = None,
        samples: int | None = None,
        depth: int = DEPTH,
        aovs: Sequence[str] = (),
        refine: str = FINEST,
        fresh_marks: bool = False,
        grid: int | None = None,
        max_grid: int | None = None,
        scratch: PathLike | None = None,
        progress: bool | Report = False,
    ) -> Image:
        """Render the scene.

        The picture is the same, bit for bit, for every memory budget and every number of threads.

        Parameters
        ----------
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
            Channels that the image has beside those that it always has, of each pixel's first
            sample: P.X P.Y P.Z, world coordinates, inf on a miss; albedo.R albedo.G albedo.B, the
            material's color, 0 on a miss. Each takes 12 bytes a pixel, twice while the frame is in
            memory.
        refine : {"sgb", "sg", "base"}
            The paper's refinements: ``base`` reads every box and all geometry wherever the original
            algorithm does; ``sg`` reads geometry only where a ray meets its box, or hits it;
            ``sgb`` reads only the boxes below those of the hierarchy that are near rays. The
            picture is the same.
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
            If a setting cannot be honoured. If there is no camera, and no object that one could
            frame.
        Cancelled
            If `progress` returned False.
        DiskFullError, StreamError
            As the system refuses.
        """
        view = View.of(self.store, camera, samples, depth, aovs)
        settings = Settings.of(
            memory=memory, threads=threads, refine=refine, grid=grid, max_grid=max_grid,
            fresh_marks=fresh_marks, scratch=scratch,
        )  # fmt: skip
        with reporting(progress) as report:
            plan = self._divide(self.store, settings, view.frame)
            self._make_room()
            with Tracer(self.store, settings, plan) as tracer:
                return picture_of(tracer, view, report)

    def plan(
        self,
        *,
        memory: str | int | None = None,
        threads: int | None = None,
        camera: Camera | None = None,
        resolution: tuple[int, int] | None = None,
        samples: int | None = None,
        depth: int = DEPTH,
        aovs: Sequence[str] = (),
        refine: str = FINEST,
        fresh_marks: bool = False,
        grid: int | None = None,
        max_grid: int | None = None,
        scratch: PathLike | None = None,
    ) -> Plan:
        """Tell what a render would take, before any work: no object is read.

        Parameters
        ----------
        resolution : tuple of 2 int, optional
            Width and height in pixels, instead of the camera's.
        memory, threads, camera, samples, depth, aovs, refine, fresh_marks, grid, max_grid, scratch
            As for `render`.

        Returns
        -------
        Plan
            ``print`` shows it as tables; `Plan.as_dict` is for JSON.

        Raises
        ------
        StoreError, BudgetError, SettingError
            As `render`.
        """
        view = View.of(self.store, camera, samples, depth, aovs).sized(resolution)
        settings = Settings.of(
            memory=memory, threads=threads, refine=refine, grid=grid, max_grid=max_grid,
            fresh_marks=fresh_marks, scratch=scratch,
        )  # fmt: skip
        held = self._divide(self.store, settings, view.frame)
        return plan_of(self.store, view, settings, held)

    def cast_rays(
        self,
        origins: Given,
        directions: Given | None = None,
        t_min: ArrayLike = 0.0,
        t_max: ArrayLike = np.inf,
        *,
        out: Out | None = None,
        progress: bool | Report = False,
        memory: str | int | None = None,
        threads: int | None = None,
        refine: str = FINEST,
        grid: int | None = None,
        max_grid: int | None = None,
        fresh_marks: bool = False,
        scratch: PathLike | None = None,
    ) -> Answer:
        """Find the nearest hit of each ray.

        Parameters
        ----------
        origins, directions : (n, 3) array_like, or path-like of an .npy file
            Float32, float64 or whole numbers, of any byte order, in world coordinates; directions
            of any length but zero. Memory maps and files may be larger than memory. Without
            directions, `origins` is an iterable of blocks, pairs of such arrays.
        t_min, t_max : float or (n,) array_like
            Hits count in (t_min, t_max), in lengths of the direction. A ray with a t_min begins at
            ``origin + t_min * direction``, computed in float64.
        out : mapping of arrays, or path-like, optional
            Arrays to fill, by the keys of the answer; or a folder that gets a file ``KEY.npy`` of
            each, and the answer is memory maps of these.
        progress : bool or callable
            As for `render`.
        memory : str or int, optional
            The budget of the whole process, as for `render`. Arrays that you give, and get, are no
            part of it.
        threads, refine, grid, max_grid, fresh_marks, scratch
            As for `render`.

        Returns
        -------
        Answer
            ``t_hit`` (n,) float64, inf for a miss; ``geometry_ids`` (n,) int32, which `geometries`
            explains, and ``primitive_ids`` (n,) int64, the object's place among its kind, both -1
            for a miss; ``primitive_normals`` (n, 3) float32, unit and geometric, 0 for a miss;
            ``primitive_uvs`` (n, 2) float32, barycentric in triangles and patches, else 0.

        Raises
        ------
        SettingError
            For rays of other shapes or dtypes, and settings that cannot be honoured.
        BudgetError, StoreError, StreamError, DiskFullError, Cancelled
            As `render`.

        Notes
        -----
        Of hits at one t the object of the least id counts. The answer is the same, bit for bit,
        whatever the memory, the threads and the refinement.
        """
        settings = Settings.of(
            memory=memory, threads=threads, refine=refine, grid=grid, max_grid=max_grid,
            fresh_marks=fresh_marks, scratch=scratch,
        )  # fmt: skip
        with reporting(progress) as report:
            question = Question(origins, directions, t_min, t_max, out, report)
            return casting.nearest(self._session, question, settings)

    def occluded(
        self,
        origins: Given,
        directions: Given | None = None,
        t_min: ArrayLike = 0.0,
        t_max: ArrayLike = np.inf,
        *,
        out: Out | None = None,
        progress: bool | Report = False,
        memory: str | int | None = None,
        threads: int | None = None,
        refine: str = FINEST,
        grid: int | None = None,
        max_grid: int | None = None,
        fresh_marks: bool = False,
        scratch: PathLike | None = None,
    ) -> Answer:
        """Find whether each ray hits anything in (t_min, t_max).

        From a to b: directions ``b - a``, t_max 1, or a little less where b is on a surface.

        Parameters
        ----------
        origins, directions : (n, 3) array_like, or path-like of an .npy file
            Float32, float64 or whole numbers, of any byte order, in world coordinates; directions
            of any length but zero. Memory maps and files may be larger than memory. Without
            directions, `origins` is an iterable of blocks, pairs of such arrays.
        t_min, t_max : float or (n,) array_like
            Hits count in (t_min, t_max), in lengths of the direction. A ray with a t_min begins at
            ``origin + t_min * direction``, computed in float64.
        out : mapping of arrays, or path-like, optional
            Arrays to fill, by the keys of the answer; or a folder that gets a file ``KEY.npy`` of
            each, and the answer is memory maps of these.
        progress : bool or callable
            As for `render`.
        memory : str or int, optional
            The budget of the whole process, as for `render`. Arrays that you give, and get, are no
            part of it.
        threads, refine, grid, max_grid, fresh_marks, scratch
            As for `render`.

        Returns
        -------
        Answer
            ``occluded`` (n,) bool.

        Raises
        ------
        SettingError
            For rays of other shapes or dtypes, and settings that cannot be honoured.
        BudgetError, StoreError, StreamError, DiskFullError, Cancelled
            As `render`.
        """
        settings = Settings.of(
            memory=memory, threads=threads, refine=refine, grid=grid, max_grid=max_grid,
            fresh_marks=fresh_marks, scratch=scratch,
        )  # fmt: skip
        with reporting(progress) as report:
            question = Question(origins, directions, t_min, t_max, out, report)
            return casting.any_hit(self._session, question, settings)

    def count_intersections(
        self,
        origins: Given,
        directions: Given | None = None,
        t_min: ArrayLike = 0.0,
        t_max: ArrayLike = np.inf,
        *,
        out: Out | None = None,
        progress: bool | Report = False,
        memory: str | int | None = None,
        threads: int | None = None,
        refine: str = FINEST,
        grid: int | None = None,
        max_grid: int | None = None,
        fresh_marks: bool = False,
        scratch: PathLike | None = None,
    ) -> Answer:
        """Count all hits of each ray in (t_min, t_max).

        A sphere or cone that is crossed twice counts twice, once where it is touched. Of faces that
        share an edge or a corner one counts there.

        Parameters
        ----------
        origins, directions : (n, 3) array_like, or path-like of an .npy file
            Float32, float64 or whole numbers, of any byte order, in world coordinates; directions
            of any length but zero. Memory maps and files may be larger than memory. Without
            directions, `origins` is an iterable of blocks, pairs of such arrays.
        t_min, t_max : float or (n,) array_like
            Hits count in (t_min, t_max), in lengths of the direction. A ray with a t_min begins at
            ``origin + t_min * direction``, computed in float64.
        out : mapping of arrays, or path-like, optional
            Arrays to fill, by the keys of the answer; or a folder that gets a file ``KEY.npy`` of
            each, and the answer is memory maps of these.
        progress : bool or callable
            As for `render`.
        memory : str or int, optional
            The budget of the whole process, as for `render`. Arrays that you give, and get, are no
            part of it.
        threads, refine, grid, max_grid, fresh_marks, scratch
            As for `render`.

        Returns
        -------
        Answer
            ``counts`` (n,) int64.

        Raises
        ------
        SettingError
            For rays of other shapes or dtypes, and settings that cannot be honoured.
        BudgetError, StoreError, StreamError, DiskFullError, Cancelled
            As `render`.
        """
        settings = Settings.of(
            memory=memory, threads=threads, refine=refine, grid=grid, max_grid=max_grid,
            fresh_marks=fresh_marks, scratch=scratch,
        )  # fmt: skip
        with reporting(progress) as report:
            question = Question(origins, directions, t_min, t_max, out, report)
            return casting.count_hits(self._session, question, settings)

    def list_intersections(
        self,
        origins: Given,
        directions: Given | None = None,
        t_min: ArrayLike = 0.0,
        t_max: ArrayLike = np.inf,
        *,
        out: Out | None = None,
        progress: bool | Report = False,
        memory: str | int | None = None,
        threads: int | None = None,
        refine: str = FINEST,
        grid: int | None = None,
        max_grid: int | None = None,
        fresh_marks: bool = False,
        scratch: PathLike | None = None,
    ) -> Answer:
        """Find all hits of each ray in (t_min, t_max).

        Parameters
        ----------
        origins, directions : (n, 3) array_like, or path-like of an .npy file
            Float32, float64 or whole numbers, of any byte order, in world coordinates; directions
            of any length but zero. Memory maps and files may be larger than memory. Without
            directions, `origins` is an iterable of blocks, pairs of such arrays.
        t_min, t_max : float or (n,) array_like
            Hits count in (t_min, t_max), in lengths of the direction. A ray with a t_min begins at
            ``origin + t_min * direction``, computed in float64.
        out : path-like, optional
            A folder that gets a file ``KEY.npy`` of each key, and the answer is memory maps of
            these. How many hits there are is not known before, so arrays are refused.
        progress : bool or callable
            As for `render`.
        memory : str or int, optional
            The budget of the whole process, as for `render`. Arrays that you give, and get, are no
            part of it.
        threads, refine, grid, max_grid, fresh_marks, scratch
            As for `render`.

        Returns
        -------
        Answer
            ``ray_splits`` (n + 1,) int64: ray i has the rows [ray_splits[i], ray_splits[i + 1]) of
            the other arrays, ordered by t, then id: those of `cast_rays`, and ``ray_ids`` (m,)
            int64.

        Raises
        ------
        SettingError
            For rays of other shapes or dtypes, and settings that cannot be honoured.
        BudgetError, StoreError, StreamError, DiskFullError, Cancelled
            As `render`.
        """
        settings = Settings.of(
            memory=memory, threads=threads, refine=refine, grid=grid, max_grid=max_grid,
            fresh_marks=fresh_marks, scratch=scratch,
        )  # fmt: skip
        with reporting(progress) as report:
            question = Question(origins, directions, t_min, t_max, out, report)
            return casting.list_hits(self._session, question, settings)


class SceneWriter(StoreWriter):
    __doc__ = StoreWriter.__doc__

    def close(self) -> Scene:
        """Complete the store and give it its name.

        Returns
        -------
        Scene
            The new store, opened.

        Raises
        ------
        DiskFullError, StreamError
            As the system refuses; nothing is left then.
        """
        return Scene(self.complete())


def open_scene(path: PathLike) -> Scene:
    """Open a store: read its header, check the sizes of its files.

    Raises
    ------
    StoreError
        If it is not a store, of another version, damaged or truncated.
    """
    return Scene(open_store(path))


Asked = ParamSpec("Asked")
Told = TypeVar("Told")


def of_scene(
    method: Callable[Concatenate[Scene, Asked], Told],
) -> Callable[Concatenate[Scene | PathLike, Asked], Told]:
    """Make a function of a method of a scene: its first argument is a scene, or where one is."""

    def function(scene: Scene | PathLike, *args: Asked.args, **settings: Asked.kwargs) -> Told:
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
render = of_scene(Scene.render)
plan = of_scene(Scene.plan)
cast_rays = of_scene(Scene.cast_rays)
occluded = of_scene(Scene.occluded)
count_intersections = of_scene(Scene.count_intersections)
list_intersections = of_scene(Scene.list_intersections)
