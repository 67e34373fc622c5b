"""One conversion: sources are read one after the other, each into a group of its store."""

from __future__ import annotations

import stat
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from bfrt.conversion.kept import KeptConversion, Writing
from bfrt.conversion.sinks import Behind, GroupSink
from bfrt.conversion.sources import SceneFile, SceneSource, StandardScene, read_nff_as_is
from bfrt.errors import SceneError
from bfrt.formats.raster.reader import read_raster
from bfrt.formats.reading import RGB, Reading
from bfrt.formats.room import Need, need_of, ordering_of, rooms_for
from bfrt.formats.source import Report
from bfrt.paths import facts_at
from bfrt.progress import DoneReport, staged
from bfrt.scene import PathLike, Scene
from bfrt.scene_writer import SceneWriter
from bfrt.spd.recipe import SpdScene
from bfrt.store.hierarchy import Hierarchy
from bfrt.store.making import Order
from bfrt.store.ordering.memory import least_memory
from bfrt.workers import usable_threads


@dataclass(frozen=True)
class Conversion:
    """Holds the checked settings of a conversion.

    Parameters
    ----------
    sources : tuple of SceneSource
        Each becomes a group; the first one's view, lights and background are the scene's.
    reading : Reading
        How files are read.
    memory : int
        The budget of the whole process, in bytes.
    writing : Writing
        The store to make, and how it is written.
    durable : bool
        Whether the store outlives a loss of power.
    """

    sources: tuple[SceneSource, ...]
    reading: Reading
    memory: int
    writing: Writing
    durable: bool

    @property
    def names(self) -> str:
        """Return the names of all sources, for errors."""
        return ", ".join(source.name for source in self.sources)

    @property
    def first_scene(self) -> SpdScene | None:
        """Return the standard scene that the first source is, if it is one."""
        return first_scene(self.sources)

    @property
    def files(self) -> list[str]:
        """Return the names of the sources, "" for those that are no files."""
        return [source.name if isinstance(source, SceneFile) else "" for source in self.sources]

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


def writing_of(
    sources: Sequence[SceneSource], target: PathLike, dtype: Any, hierarchy: Hierarchy | None,
    order: Order,
) -> Writing:  # fmt: skip
    """Return how sources are written to one scene, with what they decide themselves.

    Parameters
    ----------
    dtype : {None, "float32", "float64"}
        None keeps the files' own; NFF and standard scenes, where all are such, or rasters, become
        float32.
    hierarchy : Hierarchy, optional
        None is the first source's.
    """
    plain, first = is_plain(sources), first_scene(sources)
    return Writing(
        target,
        "float32" if is_narrow(sources) and dtype is None else dtype,
        (0.0, 0.0, 0.0) if plain else None,
        hierarchy or (Hierarchy() if first is None else first.hierarchy),
        order,
    )


def first_scene(sources: Sequence[SceneSource]) -> SpdScene | None:
    """Return the standard scene that the first source is, if it is one."""
    first = sources[0]
    return first.scene if isinstance(first, StandardScene) else None


def is_narrow(sources: Sequence[SceneSource]) -> bool:
    """Tell whether geometry is float32 where nothing else is asked for."""
    readers = {each.reader if isinstance(each, SceneFile) else None for each in sources}
    return is_plain(sources) or readers == {read_raster}


def is_plain(sources: Sequence[SceneSource]) -> bool:
    """Tell whether all sources are NFF or standard scenes, of float32 around zero."""
    files = [source for source in sources if isinstance(source, SceneFile)]
    return all(file.reader is read_nff_as_is for file in files)


def write_scene(
    conversion: Conversion, progress: DoneReport | None, kept: KeptConversion | None = None
) -> Scene:
    """Write the sources one after the other, each into its group."""
    rooms = rooms_of(conversion)
    report = staged(progress, "reading", bytes_of(conversion.sources) or None)
    done = 0 if kept is None else kept.done
    with open_writer(conversion, kept) as writer:
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
    writer.begin_group(group)
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
    return rooms_for([need_for(conversion, each) for each in conversion.sources], conversion.memory)


def need_for(conversion: Conversion, source: SceneSource) -> Need:
    """Work out what the conversion of a source takes, its objects' order included."""
    how = conversion.writing
    reading, ordered = conversion.reading, how.order != "given"
    colored = reading.color_by == RGB
    wide = how.dtype not in ("float32", np.float32)
    if isinstance(source, StandardScene):
        counts = source.scene.counts.items() if ordered else ()
        leasts = [least_memory(kind, count, wide=wide) for kind, count in counts]
        size = source.scene.store_bytes
        return need_of(source.name, size, colored=colored, ordering=max(leasts, default=0))
    ordering = ordering_of(source.name, wide=wide) if ordered else 0
    return need_of(source.name, colored=colored, smooth=reading.smooth, ordering=ordering)


def open_writer(conversion: Conversion, kept: KeptConversion | None) -> SceneWriter:
    """Open the writer of the store, which goes on where that which is kept ends."""
    how = conversion.writing
    if kept is not None:
        return kept.open(how, conversion.memory)
    return SceneWriter(
        how.target, dtype=how.dtype, origin=how.origin, hierarchy=how.hierarchy, order=how.order,
        durable=conversion.durable, memory=conversion.memory,
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
