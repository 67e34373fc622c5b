"""A group as rays go through it: its objects, its grid, its marks."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from bfrt.grid.marks import Marks, open_marks, writing_marks
from bfrt.grid.marks_home import marks_path
from bfrt.grid.marks_log import MarksLog
from bfrt.grid.partition import Limits, partition_of, subspaces
from bfrt.grid.selection import Selection
from bfrt.grid.slabs import Slabs
from bfrt.grid.voxel_rays import VoxelRays
from bfrt.phases._intersection import Intersector
from bfrt.phases.intersection import intersect_all
from bfrt.phases.outliers import Outliers
from bfrt.phases.preprocess import Marking, grid_of, layout_of
from bfrt.phases.traversal import Accelerator, Traversal
from bfrt.scan.scans import GroupScans
from bfrt.settings import Settings
from bfrt.stats import Counters
from bfrt.store.store import Group, Store
from bfrt.workers import Workers


class TracedGroup:
    """Traces rays through one group, with the grid that memory has room for.

    Parameters
    ----------
    store : Store
    group : Group
    settings : Settings
    limits : Limits
        The limits that memory sets to a grid.
    scans : GroupScans
        Its objects.
    workers : Workers

    Attributes
    ----------
    scans : GroupScans
    read : int
        Bytes that a pass reads: the most that one has.
    marks_reused : bool
        Whether marks were there.
    facts : dict
        The grid's entries in the counters.
    """

    def __init__(
        self,
        store: Store,
        group: Group,
        settings: Settings,
        limits: Limits,
        scans: GroupScans,
        workers: Workers,
    ) -> None:
        self.scans = scans
        self.read = 0
        self.marks_reused = False
        self.facts: dict[str, Any] = {}
        self._store = store
        self._number = group.number
        self._workers = workers
        self._limits = limits
        hierarchy = settings.refinement.hierarchy
        self._selection = Selection(scans, workers.threads, hierarchy)
        self._cut = partition_of(group, limits)
        self._layout = layout_of(group, self._cut, hierarchy)
        self._marks_path = marks_path(store, group, settings.scratch)
        self._grid = grid_of(store, group, self._cut.shape, self._cut.axis)
        self._outliers = Outliers(store, group, scans.order)
        self._slabs: Slabs | None = None
        self._intersectors: list[Intersector] = []

    @property
    def selective(self) -> bool:
        """Tell whether a pass reads only what is near rays."""
        return self._selection.hierarchy

    @property
    def grid(self) -> str:
        """Tell which grid it is: voxels of others are others."""
        return f"grid {self._cut.shape} across {self._cut.axis}"

    @property
    def voxels(self) -> int:
        """Return the number of voxels of the grid."""
        return self._cut.voxels

    def preprocess(
        self, subspace: int, counters: Counters, *, fresh: bool, kept: Path | None = None
    ) -> None:
        """See that there are marks.

        Parameters
        ----------
        subspace : int
            Voxels that are marked at a time, at the most.
        fresh : bool
            Whether they are made again.
        kept : Path, optional
            Folder of a checkpoint: layers that are complete are kept there until all are.
        """
        log = None if kept is None else MarksLog(kept, self._number)
        marks = None if fresh else open_marks(self._marks_path, self._store, self._layout)
        self.marks_reused = marks is not None
        if marks is None:
            try:
                marks = self._make(subspace, counters, log)
            except BaseException:
                if log is not None:
                    log.close()
                raise
        if log is not None:
            log.remove()
        self.facts = {
            "voxels": list(self._cut.shape),
            "lower": 1 << self._cut.lower_bits,
            "bricks": int(marks.first[-1]),
            "slabs": len(Slabs.cuts(marks, self._limits.slab)) - 1,
        }
        marks.close()

    def _make(self, subspace: int, counters: Counters, log: MarksLog | None = None) -> Marks:
        """Make the marks, from the layers that a log has."""
        marking = Marking(self.scans, self._selection, self._grid, self._workers, counters)
        with writing_marks(self._marks_path, self._store, self._layout) as writer:
            several = sum(1 for _ in subspaces(self._grid.layered, subspace)) > 1
            if log is not None and (several or log.is_there):
                writer.take(log, self._store, self._layout)
            marking.mark_all(subspace, writer)
        return writer.marks

    def open(self, blocks: int, subspace: int) -> Accelerator:
        """Take memory for the grid, with `blocks` lower-level blocks."""
        marks = open_marks(self._marks_path, self._store, self._layout)
        if marks is None:  # another render has made others since
            marks = self._make(subspace, Counters())
        self._slabs = Slabs(self._grid, marks, self._limits.slab, self._workers)
        voxel_rays = VoxelRays(self._cut.shape, self._cut.lower_bits, blocks)
        self._intersectors = [
            Intersector(self._grid, voxel_rays, self.scans.order)
            for _ in range(self._workers.threads)
        ]
        return Accelerator(self._slabs, voxel_rays, self._outliers)

    def intersect(self, traversal: Traversal, counters: Counters) -> None:
        """Make one pass over the group's objects."""
        phase = counters.phases.intersection
        before = phase.bytes_read
        intersect_all(
            self.scans, self._selection, traversal, self._intersectors, self._workers, counters
        )
        self.read = max(self.read, phase.bytes_read - before)

    def close(self) -> None:
        """Give the grid back."""
        if self._slabs is not None:
            self._slabs.close()
            self._slabs = None
            self._intersectors = []
