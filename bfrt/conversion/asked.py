"""What a conversion is asked for: its sources, its target, and how it reads and writes."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

from bfrt.conversion.kept import Writing
from bfrt.conversion.sources import SceneFile, SceneSource, StandardScene, read_nff_as_is
from bfrt.formats.raster.reader import read_raster
from bfrt.formats.reading import Reading
from bfrt.scene import PathLike
from bfrt.spd.recipe import SpdScene
from bfrt.store.hierarchy import Hierarchy
from bfrt.store.making import Order


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
            "float32" if self.is_narrow and self.dtype is None else self.dtype,
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
    def is_narrow(self) -> bool:
        """Tell whether geometry is float32 where nothing else is asked for."""
        readers = {s.reader if isinstance(s, SceneFile) else None for s in self.sources}
        return self.is_plain or readers == {read_raster}

    @property
    def is_plain(self) -> bool:
        """Tell whether all sources are NFF or standard scenes, of float32 around zero."""
        files = [source for source in self.sources if isinstance(source, SceneFile)]
        return all(file.reader is read_nff_as_is for file in files)
