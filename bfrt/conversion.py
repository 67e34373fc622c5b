"""Conversion of scene files to scene stores: the reader of each format, and groups of files."""

from __future__ import annotations

import logging
import os
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bfrt.errors import SceneError, SettingError
from bfrt.formats.hdf5 import read_hdf5
from bfrt.formats.las import read_las
from bfrt.formats.nff import read_nff
from bfrt.formats.npy import read_npy, read_npz
from bfrt.formats.obj import read_obj
from bfrt.formats.object_writer import SceneSink
from bfrt.formats.ply.reader import read_ply
from bfrt.formats.reading import RGB, Reading, Uses
from bfrt.formats.room import need_of, rooms_for
from bfrt.formats.stl import read_stl
from bfrt.memory import default_memory, parse_memory
from bfrt.records import Kind
from bfrt.scene import Scene, SceneWriter
from bfrt.spd import scene as spd_scene
from bfrt.spd.recipe import SpdScene
from bfrt.store.hierarchy import Hierarchy
from bfrt.store.model import Camera, Light, Vector
from bfrt.store.store import HEADER
from bfrt.workers import usable_threads

log = logging.getLogger(__name__)

Source = str | os.PathLike[str]

#: Called with the bytes of input that are done.
Report = Callable[[int], None]

Reader = Callable[[str, SceneSink, Reading, Report | None], None]


def read_nff_as_is(
    path: str, sink: SceneSink, reading: Reading, report: Report | None = None
) -> None:
    """Read NFF, which has colors of its own and no settings."""
    reading.refuse_all_but(path)
    read_nff(path, sink, progress=report)


READERS: dict[str, Reader] = {
    ".nff": read_nff_as_is,
    ".ply": read_ply,
    ".stl": read_stl,
    ".obj": read_obj,
    ".npy": read_npy,
    ".npz": read_npz,
    ".h5": read_hdf5,
    ".hdf5": read_hdf5,
    ".las": read_las,
    ".laz": read_las,
}

#: Blocks that wait to be written while the next is read.
PENDING = 4


def is_store(source: str | os.PathLike[str]) -> bool:
    """Tell whether a path is a scene store, or has the name of one."""
    path = Path(source)
    return (path / HEADER).exists() or path.suffix == ".bfrt" or path.is_dir()


def convert(
    source: Source | Sequence[Source],
    target: str | os.PathLike[str],
    *,
    dtype: Any = None,
    hierarchy: Hierarchy | None = None,
    memory: str | int | None = None,
    scratch: str | os.PathLike[str] | None = None,
    radius: float | str | None = None,
    positions: str | None = None,
    color_by: str | None = None,
    colormap: str | None = None,
    color_range: tuple[float, float] | None = None,
    skip_invalid: bool = False,
    triangulate: bool = False,
    polygons: bool = False,
    progress: Report | None = None,
    durable: bool = True,
) -> Scene:
    """Convert scene files to a scene store, streaming.

    Parameters
    ----------
    source : path-like, or sequence of path-like
        A file of NFF, PLY, STL, OBJ, NumPy (.npy, .npz), HDF5, LAS or LAZ, "-" for NFF from
        standard input, or ``spd:NAME:SIZE`` for a standard scene. Of several, each becomes a group
        with a grid of its own, which suits a small dense thing in a large sparse one. The view, the
        lights and the background are the first file's. A setting applies to the files that use it.
    target : path-like
        The store to make. An existing store is replaced when the new one is complete; anything
        else is refused.
    dtype : {None, "float32", "float64"}
        The type that geometry is stored as. None keeps the file's own: float32 or float64 by its
        types, and float64 for text without types (OBJ, text STL). If all sources are NFF or
        standard scenes, None is float32.
    hierarchy : Hierarchy, optional
        Settings of the box hierarchy. By default `Hierarchy`'s, and for a standard scene the
        paper's settings for that scene.
    memory : str or int, optional
        The budget of the whole process: ``"256MiB"`` or bytes. By default a quarter of the
        machine's memory, or of its cgroup's limit. The least depends on the files: 53 MiB for small
        ones. A mesh whose vertices take more is joined on disk, in forward passes.
    scratch : path-like, optional
        Folder for the temporary files of such a join. By default the target's parent.
    radius : float or str, optional
        The radius of points, in the file's units, or the name of the column or array with a radius
        for each point.
    positions : str, optional
        Name of the array or dataset with the points' positions, or of the group with x, y and z.
    color_by : str, optional
        Name of the column or array of numbers that a color map turns into colors; "rgb" for the
        file's own colors, which are rounded to 65,536. A face has the mean of its vertices.
    colormap : str, optional
        The map: "cubehelix", the default, or "gray"; with matplotlib any of its maps.
    color_range : (float, float), optional
        The numbers that get the map's first and last color. By default the least and the greatest
        number, which costs a pass over the file.
    skip_invalid : bool
        Drop objects that are not finite and faces of fewer than three corners, and log how many. By
        default they are refused.
    triangulate : bool
        Store all faces of more than three corners as triangles, a face of k corners as k - 2. By
        default faces that are not flat become triangles, with a logged count, and flat ones
        polygons.
    polygons : bool
        Store all faces of more than three corners as polygons, each in the plane that fits it.
    progress : callable, optional
        Called with the number of bytes read so far, of all files.
    durable : bool
        Whether the store outlives a loss of power; not needed for one that is soon removed.

    Returns
    -------
    Scene
        The new store, opened.

    Raises
    ------
    SceneError, ShortReadError
        If a file is damaged or no scene: one line with file, place, what was found and what was
        expected. Nothing is left behind.
    BudgetError
        If the budget is below the least that works, which the message names.
    SettingError
        If no reader knows a file's suffix, a setting does not fit the file, or no file uses it.
    DiskFullError, StreamError
        If the system refuses a read or a write; nothing is left behind.
    """
    sources = [source] if isinstance(source, (str, os.PathLike)) else source
    names = [os.fspath(each) for each in sources]
    if not names:
        raise SettingError("convert: found no scene, expected one or more")
    readers = [reader_of(name) for name in names]
    reading = Reading(
        radius=radius,
        positions=positions,
        color_by=color_by,
        colormap=colormap,
        color_range=color_range,
        skip_invalid=skip_invalid,
        triangulate=triangulate,
        polygons=polygons,
        scratch=Path(target).resolve().parent if scratch is None else Path(scratch),
        uses=Uses(len(names)),
    )
    budget = default_memory() if memory is None else parse_memory(memory)
    pairs = zip(names, readers, strict=True)
    scenes = [None if reader else parse_spd(name) for name, reader in pairs]
    if scenes[0] is not None:
        hierarchy = hierarchy or scenes[0].hierarchy
    sizes = [None if spd is None else spd.store_bytes for spd in scenes]
    sized = zip(names, sizes, strict=True)
    needs = [need_of(name, size, colored=color_by == RGB) for name, size in sized]
    rooms = rooms_for(needs, budget)
    plain = all(reader in (None, read_nff_as_is) for reader in readers)
    with SceneWriter(
        target,
        dtype="float32" if plain and dtype is None else dtype,
        origin=(0.0, 0.0, 0.0) if plain else None,
        hierarchy=hierarchy,
        durable=durable,
    ) as writer:
        if scenes[0] is not None:
            writer.expect(scenes[0].counts, scenes[0].surface)
        for number, (name, reader, spd) in enumerate(zip(names, readers, scenes, strict=True)):
            sink = GroupSink(writer, number)
            if reader is not None:
                own = replace(reading, room=rooms[number])
                read_scene(reader, name, sink, own, after(progress, names[:number]))
            elif spd is not None:
                reading.refuse_all_but(name)
                spd.feed(sink, usable_threads())
        with complaints_of(", ".join(names)):
            scene = writer.close()
    if not scene.objects:
        log.warning("%s: no object was found", ", ".join(names))
    return scene


def reader_of(name: str) -> Reader | None:
    """Return the reader of a file's format; None for a standard scene.

    Raises
    ------
    SettingError
        If nothing does.
    """
    if name.startswith("spd:"):
        return None
    suffix = ".nff" if name == "-" else Path(name).suffix.lower()
    if suffix not in READERS:
        raise SettingError(
            f"{name}: found suffix {Path(name).suffix!r}, expected {', '.join(READERS)}, "
            "spd:NAME:SIZE, or - for NFF from standard input"
        )
    return READERS[suffix]


def after(progress: Report | None, files: list[str]) -> Report | None:
    """Return a reporter that counts some files as read already."""
    if progress is None:
        return None
    read = sum(path.stat().st_size for path in map(Path, files) if path.is_file())
    return lambda done: progress(read + done)


class GroupSink:
    """Gives the reader of one of several files a scene writer: its objects become a group.

    The first file's view, lights and background are the scene's.
    """

    def __init__(self, writer: SceneWriter, group: int) -> None:
        self._writer = writer
        self._group = group
        self.material = writer.material
        self.prepare = partial(writer.prepare, group=group)
        self.add = writer.add
        self.append = partial(writer.append, group=group)
        self.append_polygons = partial(writer.append_polygons, group=group)

    def camera(self, camera: Camera) -> None:
        if self._group == 0:
            self._writer.camera(camera)

    def light(self, light: Light) -> None:
        if self._group == 0:
            self._writer.light(light)

    def background(self, color: Vector) -> None:
        if self._group == 0:
            self._writer.background(color)


class Behind:
    """Keeps a sink one step behind the reader: threads prepare blocks while the next are read.

    Blocks are added in the order they came in, at most `PENDING` later.
    """

    def __init__(self, sink: GroupSink) -> None:
        self._sink = sink
        self._threads = ThreadPoolExecutor(usable_threads(), "bfrt-prepare")
        self._pending: deque[Callable[[], object]] = deque()
        self._begun: set[Kind] = set()
        self.camera = sink.camera
        self.light = sink.light
        self.background = sink.background
        self.material = sink.material

    def append(self, kind: Kind, records: NDArray[Any], materials: NDArray[np.uint32]) -> None:
        if kind not in self._begun:
            self._begin(kind, lambda: self._sink.append(kind, records, materials))
        else:
            self._prepare(kind, records, np.zeros_like(materials), materials)

    def append_polygons(
        self, vertices: NDArray[Any], counts: NDArray[np.int64], materials: NDArray[np.uint32]
    ) -> None:
        if Kind.POLYGON not in self._begun:
            self._begin(
                Kind.POLYGON, lambda: self._sink.append_polygons(vertices, counts, materials)
            )
        else:
            self._prepare(Kind.POLYGON, vertices, counts.astype(np.uint32), materials)

    def _prepare(self, kind: Kind, *block: NDArray[Any]) -> None:
        """Have a thread prepare a block: its records, counts and materials."""
        made = self._threads.submit(self._sink.prepare, kind, *block)
        self._hand_over(lambda: self._sink.add(made.result()))

    def _begin(self, kind: Kind, add: Callable[[], object]) -> None:
        """Add a kind's first block at once: it decides the store's origin and the dtype."""
        self._begun.add(kind)
        self._hand_over(add)
        self._wait(0)

    def _hand_over(self, add: Callable[[], object]) -> None:
        self._pending.append(add)
        self._wait(PENDING)

    def _wait(self, most: int) -> None:
        while len(self._pending) > most:
            self._pending.popleft()()

    def __enter__(self) -> Behind:
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        try:
            if kind is None:
                self._wait(0)
        finally:
            self._threads.shutdown(cancel_futures=True)


def read_scene(
    reader: Reader, name: str, sink: GroupSink, reading: Reading, progress: Report | None
) -> None:
    """Read a file into a sink, whose errors get the file's name too."""
    with complaints_of(name), Behind(sink) as behind:
        reader(name, behind, reading, progress)


@contextmanager
def complaints_of(name: str) -> Iterator[None]:
    """Have errors about a scene begin with its file's name."""
    try:
        yield
    except SceneError as error:
        if str(error).startswith((name, "<stdin>")):
            raise
        raise SceneError(f"{name}: {error}") from error


def parse_spd(name: str, **options: str | None) -> SpdScene:
    """Return the scene that ``spd:NAME:SIZE`` names, with the options that are not None."""
    _, _, rest = name.partition(":")
    scene, _, size = rest.partition(":")
    if not (size.isascii() and size.isdigit()):
        raise SettingError(f"{name}: found size {size!r}, expected spd:NAME:SIZE, as spd:rings:7")
    given = {key: value for key, value in options.items() if value is not None}
    return spd_scene(scene, int(size), **given)


class _View:
    """Keeps the camera of an NFF file, and nothing else."""

    def __init__(self) -> None:
        self.found: Camera | None = None

    def camera(self, camera: Camera) -> None:
        self.found = camera

    def light(self, light: object) -> None:
        """Ignore a light: a view has none."""

    def background(self, color: object) -> None:
        """Ignore a background: a view has none."""

    def material(self, material: object) -> int:
        return 0

    def append(self, kind: object, records: object, materials: object) -> None:
        """Ignore objects."""

    def append_polygons(self, vertices: object, counts: object, materials: object) -> None:
        """Ignore polygons."""


def read_view(path: str | os.PathLike[str]) -> Camera:
    """Return the camera of an NFF file, which may consist of a ``v`` alone.

    Raises
    ------
    SettingError
        If it has none.
    """
    view = _View()
    read_nff(path, view)
    if view.found is None:
        raise SettingError(f"{os.fspath(path)}: found no view, expected a v with its fields")
    return view.found
