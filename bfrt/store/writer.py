"""SceneWriter: blocks of NumPy arrays in, a scene store out.

Everything is written under a temporary name, made durable and renamed at the end, so that what
opens is whole. Blocks pass through once (bfrt/store/shape_writer.py): geometry as given, boxes and
materials beside it.
"""

from __future__ import annotations

import logging
import os
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Any

from numpy.typing import ArrayLike

from bfrt.errors import SettingError
from bfrt.memory import default_memory, parse_memory
from bfrt.paths import HEADER, MAGIC, check_names, check_outside, is_there, path_of, without_links
from bfrt.progress import DoneReport
from bfrt.refusals import in_memory
from bfrt.store.atomic_folder import AtomicFolder
from bfrt.store.coordinates import Coordinates
from bfrt.store.header import header_text
from bfrt.store.hierarchy import Hierarchy
from bfrt.store.making import Making, Order, checked_order
from bfrt.store.model import Vector
from bfrt.store.shape_writer import ShapeWriter
from bfrt.store.store import MADE, VERSION, Store, has_magic, open_store
from bfrt.store.view_writer import ViewWriter
from bfrt.streams.writer import FileWriter

if TYPE_CHECKING:
    from typing import Self  # Python 3.11

log = logging.getLogger(__name__)


def check_new_store(path: str | os.PathLike[str]) -> Path:
    """Return the path of a store that may be made, or replaced.

    Raises
    ------
    SettingError
        If it is something else than a store, or in one, or has too long a name.
    """
    given = path_of("store", path)
    target = without_links(given)
    if is_there(target) and not has_magic(target):
        raise SettingError(f"{given}: exists and is no scene store: it is not replaced")
    check_outside(str(given), target.parent)
    check_names(str(given), target)
    return given


class StoreWriter(ViewWriter, ShapeWriter):
    """Writes a scene store, block by block.

    Parameters
    ----------
    path : path-like
        The store to make. A store that is there is replaced when this one is complete; anything
        else that is there is refused.
    dtype : {None, "float32", "float64"}
        The type that geometry is stored as. None keeps float32 as it is and all else as float64.
    origin : (3,) array_like, optional
        The point that boxes and float32 coordinates are relative to, world coordinates. By default
        zero if the first block is float32, and the center of the first block if it is float64.
    hierarchy : Hierarchy, optional
        Settings of the box hierarchy, which is made when all objects are written. By default
        `Hierarchy`'s.
    order : {"given", "spatial", "auto"}
        The order in which objects are stored: as they are given; spatial, in treelets, for
        ``refine="tree"``; or auto, which is spatial (docs/tree.rst). Ids count in the order given,
        always. Until objects are in order they take up to three times the store's room on disk.
    durable : bool
        Whether the store outlives a loss of power once it has its name, which takes a moment.
    memory : str or int, optional
        The budget of the whole process while objects are brought into order: ``"256MiB"`` or bytes.
        By default a quarter of the machine's memory, or of its cgroup's limit. The store is the
        same whatever it is.

    Raises
    ------
    SceneError
        For coordinates that are not finite, shapes that do not fit, materials that do not exist,
        and a scene that is so small, so far from the origin, that float64 cannot tell its parts
        apart.
    DiskFullError, StreamError
        If the system refuses a write; nothing is left behind.
    BudgetError
        From `complete`, if the budget is below the least that works for spatial order, which the
        message names; nothing is left behind.
    SettingError
        If `path` exists and is no store, or is in one, and for calls after the end. An error in a
        block, or an interrupt while one is written, is an end too: half a block is never kept.

    Examples
    --------
    >>> with bfrt.SceneWriter("cloud.bfrt") as writer:
    ...     for centers, radii in blocks:
    ...         writer.spheres(centers, radii)
    """

    def __init__(
        self,
        path: str | os.PathLike[str],
        *,
        dtype: Any = None,
        origin: ArrayLike | None = None,
        hierarchy: Hierarchy | None = None,
        order: Order = "auto",
        durable: bool = True,
        memory: str | int | None = None,
    ) -> None:
        self.path = check_new_store(path)
        coordinates = Coordinates(dtype, origin)
        budget = default_memory() if memory is None else parse_memory(memory)
        making = Making(hierarchy or Hierarchy(), checked_order(order), durable, budget)
        ViewWriter.__init__(self)
        ShapeWriter.__init__(self, AtomicFolder(self.path, durable), coordinates, making)

    def place(self, origin: Vector, crs: str) -> None:
        """Take where objects are: a point near them, and their reference system, if they have one.

        Parameters
        ----------
        origin : tuple of 3 float
            What coordinates are relative to, if nothing has decided that so far.
        crs : str
            As for `crs`; empty for none.

        Raises
        ------
        SceneError
            As for `crs`.
        """
        self.propose_origin(origin)
        if crs:
            self.crs(crs)

    def complete(self, progress: DoneReport | None = None) -> Store:
        """Complete the store and give it its name.

        Parameters
        ----------
        progress : callable, optional
            Called with a `bfrt.progress.Done` of stage "ordering"; returning False cancels.

        Returns
        -------
        Store
            The new store, opened.

        Raises
        ------
        SceneError
            If the scene is too small for its distance from the origin, or `expect` announced other
            counts.
        SettingError
            If the writer is closed.
        DiskFullError, StreamError
            If the system refuses a write; nothing is left behind.
        BudgetError
            If the budget is below the least for spatial order; nothing is left behind.
        Cancelled
            If `progress` returned False; nothing is left behind.
        """
        self._check_open()
        try:
            with in_memory(f"{self.path}: completing"):
                self._put(HEADER, self._header(progress))
                self._folder.sync()
                made = open_store(self._folder.aside)  # what replaces a store is whole
                self._is_whole()
                with made.folder.closed_on_error():
                    self._folder.take_name()
        except BaseException:
            self.abandon()
            raise
        self._open = False
        degenerate = sum(s.degenerate for s in made.streams)
        if degenerate:
            told = "%s: %d degenerate objects (no length, no area) are kept and never hit"
            log.warning(told, self.path, degenerate)
        return made.moved(self.path)

    def _header(self, progress: DoneReport | None = None) -> dict[str, Any]:
        """Complete all other files; return what the header says."""
        records = self._close(progress)
        local = [name for group in self._written for name in group.local]
        self._put(MADE, {"hierarchy_seconds": self.hierarchy_seconds, "local": local})
        return {
            "magic": MAGIC,
            "version": VERSION,
            **self.view,
            **records,
        }

    def _is_whole(self) -> None:
        """Note that the store has all but its name."""

    def _put(self, name: str, fields: dict[str, Any]) -> None:
        with FileWriter(self._folder.aside / name, self._folder.durable) as file:
            file.write(header_text(fields).encode())

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        if kind is not None:
            self.abandon()
        elif self._open:  # not closed in the block already
            self.complete()
