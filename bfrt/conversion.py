"""Scene files in, scene stores out: which reader reads what."""

from __future__ import annotations

import os
from collections import deque
from collections.abc import Callable, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bfrt.errors import SceneError, SettingError
from bfrt.records import Kind
from bfrt.scene.hierarchy import Hierarchy
from bfrt.scene.model import Camera, Light, Vector
from bfrt.formats.nff import read_nff
from bfrt.scene.store import HEADER, Store, open_store
from bfrt.scene.writer import SceneWriter
from bfrt.spd import scene as spd_scene
from bfrt.spd.recipe import SpdScene
from bfrt.workers import usable_threads

SUFFIXES = (".nff",)

#: Blocks that wait to be written while the next is read.
PENDING = 4

Source = str | os.PathLike[str]

#: Called with the bytes of input that are done.
Report = Callable[[int], None]


def is_store(source: str | os.PathLike[str]) -> bool:
    """Whether a path is (or was meant to be) a scene store."""
    path = Path(source)
    return (path / HEADER).exists() or path.suffix == ".bfrt" or path.is_dir()


def convert(
    source: Source | Sequence[Source],
    target: str | os.PathLike[str],
    *,
    dtype: Any = "float32",
    hierarchy: Hierarchy | None = None,
    progress: Report | None = None,
    durable: bool = True,
) -> Store:
    """Convert scene files to a scene store, streaming.

    Parameters
    ----------
    source : path-like, or sequence of path-like
        An NFF file, "-" for NFF from standard input, or ``spd:NAME:SIZE`` for a standard scene.
        Of several, each becomes a group, with a grid of its own: one small dense thing in a large
        sparse one. The view, the lights and the background are the first file's.
    target : path-like
        The store to make. One that is there is replaced when the new one is complete.
    dtype : {"float32", "float64"}
        What geometry is stored as.
    hierarchy : Hierarchy, optional
        Settings of the box hierarchy; by default the paper's, for a standard scene its own.
    progress : callable, optional
        Called with the bytes read so far, of all files.
    durable : bool
        Whether the store outlives a loss of power; of no use for one that is removed soon.

    Returns
    -------
    Store
        The new store, opened.

    Raises
    ------
    SceneError
        If the file is no scene: one line with file, line, what was found and expected. Nothing
        is left behind.
    SettingError
        If no reader knows the file's suffix.
    """
    sources = [source] if isinstance(source, (str, os.PathLike)) else source
    names = [os.fspath(each) for each in sources]
    if not names:
        raise SettingError("convert: found no scene, expected one or more")
    scenes = [parse_spd(name) if name.startswith("spd:") else None for name in names]
    if scenes[0] is not None:
        hierarchy = hierarchy or scenes[0].hierarchy
    with SceneWriter(
        target, dtype=dtype, origin=(0.0, 0.0, 0.0), hierarchy=hierarchy, durable=durable
    ) as writer:
        if scenes[0] is not None:
            writer.expect(scenes[0].counts, scenes[0].surface)
        for number, (name, spd) in enumerate(zip(names, scenes, strict=True)):
            sink = GroupSink(writer, number)
            if spd is not None:
                spd.feed(sink, usable_threads())
            elif name == "-" or Path(name).suffix.lower() in SUFFIXES:
                read_scene(name, sink, after(progress, names[:number]))
            else:
                raise SettingError(
                    f"{name}: found suffix {Path(name).suffix!r}, expected {', '.join(SUFFIXES)}, "
                    "spd:NAME:SIZE, or - for NFF from standard input"
                )
    return open_store(target)


def after(progress: Report | None, files: list[str]) -> Report | None:
    """A report that counts these files as read."""
    if progress is None:
        return None
    read = sum(path.stat().st_size for path in map(Path, files) if path.is_file())
    return lambda done: progress(read + done)


class GroupSink:
    """A scene writer as one file of several sees it: its objects are a group.

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
    """A sink one step behind the reader: blocks are written while the next are read.

    Blocks are copied, for the reader uses its own again; at most `PENDING` wait.
    """

    def __init__(self, sink: GroupSink) -> None:
        self._sink = sink
        self._thread = ThreadPoolExecutor(1, "bfrt-writer")
        self._pending: deque[Future[None]] = deque()
        self.camera = sink.camera
        self.light = sink.light
        self.background = sink.background
        self.material = sink.material

    def append(self, kind: Kind, records: NDArray[Any], materials: NDArray[np.uint32]) -> None:
        self._hand_over(self._sink.append, kind, records.copy(), materials.copy())

    def append_polygons(
        self, vertices: NDArray[Any], counts: NDArray[Any], materials: NDArray[np.uint32]
    ) -> None:
        copies = vertices.copy(), counts.copy(), materials.copy()
        self._hand_over(self._sink.append_polygons, *copies)

    def _hand_over(self, write: Callable[..., None], *block: Any) -> None:
        self._pending.append(self._thread.submit(write, *block))
        self._wait(PENDING)

    def _wait(self, most: int) -> None:
        while len(self._pending) > most:
            self._pending.popleft().result()

    def __enter__(self) -> Behind:
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        try:
            if kind is None:
                self._wait(0)
        finally:
            self._thread.shutdown(cancel_futures=True)


def read_scene(name: str, sink: GroupSink, progress: Report | None) -> None:
    """Read NFF into a sink, whose own complaints get the file's name too."""
    try:
        with Behind(sink) as behind:
            read_nff(name, behind, progress=progress)
    except SceneError as error:
        if str(error).startswith((name, "<stdin>")):
            raise
        raise SceneError(f"{name}: {error}") from error


def parse_spd(name: str, **options: str | None) -> SpdScene:
    """The scene that ``spd:NAME:SIZE`` names, with those options that are not None."""
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
        """A view has no lights."""

    def background(self, color: object) -> None:
        """Nor a background."""

    def material(self, material: object) -> int:
        return 0

    def append(self, kind: object, records: object, materials: object) -> None:
        """Objects are passed over."""

    def append_polygons(self, vertices: object, counts: object, materials: object) -> None:
        """Polygons too."""


def read_view(path: str | os.PathLike[str]) -> Camera:
    """The camera of an NFF file, of which only the ``v`` is needed.

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
