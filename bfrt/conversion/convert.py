"""The conversion of scene files and standard scenes to a store: each becomes a group."""

from __future__ import annotations

import logging
import stat
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

from bfrt.checkpoint.checkpoint import Checkpoint, keeping
from bfrt.checkpoint.identity import identity_of_conversion
from bfrt.conversion.kept import EVERY, KeptConversion, Writing, check_can_be_kept, find_state
from bfrt.conversion.sinks import Behind, GroupSink
from bfrt.conversion.sources import (
    SceneFile,
    SceneSource,
    StandardScene,
    read_nff_as_is,
    sources_of,
)
from bfrt.errors import SceneError
from bfrt.formats.reading import RGB, Reading, Uses
from bfrt.formats.room import need_of, rooms_for
from bfrt.formats.source import Report
from bfrt.memory import default_memory, parse_memory
from bfrt.paths import check_apart, facts_at, path_of, without_links
from bfrt.progress import DoneReport, check_report, staged
from bfrt.refusals import in_memory
from bfrt.scene import PathLike, Scene, SceneWriter
from bfrt.spd.recipe import SpdScene
from bfrt.store.hierarchy import Hierarchy
from bfrt.store.making import Order, checked_order
from bfrt.workers import usable_threads

log = logging.getLogger(__name__)


@dataclass(frozen=True)
class Conversion:
    """Holds the checked settings of a conversion.

    Parameters
    ----------
    sources : tuple of SceneFile or StandardScene
        Each becomes a group; the first one's view, lights and background are the scene's.
    target : path-like
        The store to make.
    reading : Reading
        How files are read.
    memory : int
        The budget of the whole process, in bytes.
    dtype : {None, "float32", "float64"}
        The type that geometry is stored as; None keeps the files' own.
    hierarchy : Hierarchy, optional
        Settings of the box hierarchy, if others than the first source's are asked for.
    order : {"given", "spatial", "auto"}
        The order in which objects are stored.
    durable : bool
        Whether the store outlives a loss of power.
    """

    sources: tuple[SceneSource, ...]
    target: PathLike
    reading: Reading
    memory: int
    dtype: Any
    hierarchy: Hierarchy | None
    order: Order
    durable: bool

    @property
    def names(self) -> str:
        """Return the names of all sources, for errors."""
        return ", ".join(source.name for source in self.sources)

    @property
    def first_scene(self) -> SpdScene | None:
        """Return the standard scene that the first source is, if it is one."""
        first = self.sources[0]
        return first.scene if isinstance(first, StandardScene) else None

    @property
    def files(self) -> list[str]:
        """Return the names of the sources, "" for those that are no files."""
        return [source.name if isinstance(source, SceneFile) else "" for source in self.sources]

    @property
    def writing(self) -> Writing:
        """Return how the store is written."""
        first = self.first_scene
        return Writing(
            self.target,
            "float32" if self.is_plain and self.dtype is None else self.dtype,
            (0.0, 0.0, 0.0) if self.is_plain else None,
            self.hierarchy or (Hierarchy() if first is None else first.hierarchy),
            self.order,
        )

    @property
    def settings(self) -> dict[str, Any]:
        """Return all that changes the store, for JSON."""
        how = self.writing
        return {
            "dtype": None if how.dtype is None else str(how.dtype),
            "hierarchy": asdict(how.hierarchy),
            "order": how.order,
            **self.reading.settings,
        }

    @property
    def is_plain(self) -> bool:
        """Tell whether all sources are NFF or standard scenes, of float32 around zero."""
        files = [source for source in self.sources if isinstance(source, SceneFile)]
        return all(file.reader is read_nff_as_is for file in files)


def convert(
    source: PathLike | Sequence[PathLike],
    target: PathLike,
    *,
    dtype: Any = None,
    hierarchy: Hierarchy | None = None,
    order: Order = "auto",
    memory: str | int | None = None,
    scratch: PathLike | None = None,
    radius: float | str | None = None,
    positions: str | None = None,
    color_by: str | None = None,
    colormap: str | None = None,
    color_range: tuple[float, float] | None = None,
    frame: int | None = None,
    skip_invalid: bool = False,
    triangulate: bool = False,
    polygons: bool = False,
    smooth: bool = False,
    external_storage: bool = False,
    progress: DoneReport | None = None,
    durable: bool = True,
    checkpoint: PathLike | Checkpoint | None = None,
    every: float = EVERY,
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
    order : {"auto", "given", "spatial"}
        The order in which objects are stored: as they are given; spatial, in treelets, for
        ``refine="tree"``; or auto, which is spatial, since that costs little (docs/tree.rst). Ids
        count in the order given, always. Objects are brought into order when all are read: until
        that is done the disk needs up to three times the store's bytes.
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
    frame : int, optional
        Of several frames, as H5MD, H5Part and openPMD have, the one to read: from 0, or from -1
        back. By default the last.
    skip_invalid : bool
        Drop objects that are not finite and faces of fewer than three corners, and log how many. By
        default they are refused.
    triangulate : bool
        Store all faces of more than three corners as triangles, a face of k corners as k - 2. By
        default faces that are not flat become triangles, with a logged count, and flat ones
        polygons.
    polygons : bool
        Store all faces of more than three corners as polygons, each in the plane that fits it.
    smooth : bool
        Store faces whose corners have normals in the file as patches, which are shaded by them:
        OBJ's ``vn``, PLY's ``nx ny nz``, an array ``normals`` beside ``vertices``. Those of more
        corners become triangles before. By default normals are passed over, which is logged.
    external_storage : bool
        Follow HDF5's external storage: rows that are in files of any kind, which a dataset names.
        It reads whatever this process may read: it is for files that one trusts. By default such a
        dataset is refused.
    progress : callable, optional
        Called with the number of bytes read so far, of all files; and after that, of a store in
        spatial order, with the number of objects that are in order. The number is a
        `bfrt.progress.Done`, which tells the stage, "reading" or "ordering", and the total.
        Returning False cancels.
    durable : bool
        Whether the store outlives a loss of power; not needed for one that is soon removed.
    checkpoint : path-like, optional
        Folder, in the file system of the target, in which the store is made and its state is kept:
        the same call goes on from there after a kill, and does not read again the sources that
        were complete; the store has the same bytes (docs/checkpoints.rst). It is removed when the
        store is complete.
    every : float
        Seconds between two saves of the state at the least; it is saved when a source is complete,
        or a stream is in order, and where that takes long less often: it costs no more than a
        fiftieth of the time. 0 means every time, whatever it costs.

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
        If no reader knows a file's suffix, a setting does not fit the file, or no file uses it; if
        `checkpoint` has the state of other work, or a source that was complete has changed.
    CheckpointError
        If the state in `checkpoint`, or a file of the store there, is damaged.
    DiskFullError, StreamError
        If the system refuses a read or a write; nothing is left behind.
    Cancelled
        If `progress` returned False; nothing is left behind.
    """
    order = checked_order(order)
    sources = sources_of(source)
    beside = without_links(path_of("store", target)).parent
    check_report(progress)
    reading = Reading(
        radius=radius,
        positions=positions,
        color_by=color_by,
        colormap=colormap,
        color_range=color_range,
        frame=frame,
        skip_invalid=skip_invalid,
        triangulate=triangulate,
        polygons=polygons,
        smooth=smooth,
        external_storage=external_storage,
        scratch=beside if scratch is None else path_of("scratch", scratch),
        uses=Uses(len(sources)),
    )
    budget = default_memory() if memory is None else parse_memory(memory)
    conversion = Conversion(sources, target, reading, budget, dtype, hierarchy, order, durable)
    with in_memory(f"{conversion.names}: converting", budget):
        if checkpoint is None:
            scene = write_scene(conversion, progress)
        else:
            scene = write_kept(conversion, checkpoint, every, progress)
    if not scene.objects:
        log.warning("%s: no object was found", conversion.names)
    return scene


def write_kept(
    conversion: Conversion,
    checkpoint: PathLike | Checkpoint,
    every: float,
    progress: DoneReport | None,
) -> Scene:
    """Write the sources as `write_scene` does, with their state in a folder."""
    check_can_be_kept(conversion.files)
    if not isinstance(checkpoint, Checkpoint):
        check_apart(conversion.target, checkpoint)
    with keeping(checkpoint, every, each=0.0) as kept:
        assert kept is not None
        return go_on(conversion, kept, progress)


def go_on(conversion: Conversion, checkpoint: Checkpoint, progress: DoneReport | None) -> Scene:
    """Write the sources as `write_scene` does, from where the state in a checkpoint ends."""
    names = [source.name for source in conversion.sources]
    find_state(checkpoint, identity_of_conversion(names, conversion.settings))
    with KeptConversion(checkpoint, conversion.files, conversion.reading.uses) as kept:
        kept.check_inputs()
        store = kept.named(conversion.target)
        return write_scene(conversion, progress, kept) if store is None else Scene(store)


def write_scene(
    conversion: Conversion, progress: DoneReport | None, kept: KeptConversion | None = None
) -> Scene:
    """Write the sources one after the other, each into its group."""
    rooms = rooms_of(conversion)
    report = staged(progress, "reading", bytes_of(conversion.sources) or None)
    done = 0 if kept is None else kept.done
    with open_writer(conversion) if kept is None else kept.open(conversion.writing) as writer:
        if conversion.first_scene is not None and not done:
            writer.expect(conversion.first_scene.counts, conversion.first_scene.surface)
        for group in range(done, len(rooms)):
            if kept is not None:
                kept.begin()
            write_group(conversion, group, rooms[group], writer, report)
            if kept is not None:
                kept.complete()
        with complaints_of(conversion.names):
            return Scene(writer.complete(progress))


def write_group(
    conversion: Conversion, group: int, room: int, writer: SceneWriter, report: Report | None
) -> None:
    """Write a source into its group."""
    source, sink = conversion.sources[group], GroupSink(writer, group)
    if isinstance(source, StandardScene):
        conversion.reading.refuse_all_but(source.name)
        source.scene.feed(sink, usable_threads())
    else:
        reading = replace(conversion.reading, room=room)
        read_file(source, sink, reading, after(report, conversion.sources[:group]))


def rooms_of(conversion: Conversion) -> list[int]:
    """Return the bytes that each source's conversion leaves of the budget for vertices.

    Raises
    ------
    BudgetError
        If the budget is less than the least that works for all.
    """
    colored = conversion.reading.color_by == RGB
    sizes = [
        s.scene.store_bytes if isinstance(s, StandardScene) else None for s in conversion.sources
    ]
    sized = zip(conversion.sources, sizes, strict=True)
    smooth = conversion.reading.smooth
    needs = [need_of(source.name, size, colored=colored, smooth=smooth) for source, size in sized]
    return rooms_for(needs, conversion.memory)


def open_writer(conversion: Conversion) -> SceneWriter:
    """Open the writer of the store."""
    how = conversion.writing
    return SceneWriter(
        how.target, dtype=how.dtype, origin=how.origin, hierarchy=how.hierarchy, order=how.order,
        durable=conversion.durable,
    )  # fmt: skip


def read_file(file: SceneFile, sink: GroupSink, reading: Reading, progress: Report | None) -> None:
    """Read a file into a sink, whose errors get the file's name too."""
    with complaints_of(file.name), Behind(sink) as behind:
        file.reader(file.name, behind, reading, progress)


def after(progress: Report | None, sources: Sequence[SceneSource]) -> Report | None:
    """Return a reporter that counts some files as read already."""
    if progress is None:
        return None
    read = bytes_of(sources)
    return lambda done: progress(read + done)


def bytes_of(sources: Sequence[SceneSource]) -> int:
    """Return the bytes of those sources that are files."""
    files = [facts_at(Path(each.name)) for each in sources if isinstance(each, SceneFile)]
    return sum(file.st_size for file in files if file is not None and stat.S_ISREG(file.st_mode))


@contextmanager
def complaints_of(name: str) -> Iterator[None]:
    """Have errors about a scene begin with its file's name."""
    try:
        yield
    except SceneError as error:
        if str(error).startswith((name, "<stdin>")):
            raise
        raise SceneError(f"{name}: {error}") from error
