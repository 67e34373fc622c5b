"""A group as rays go through it: its objects, its grid, its marks."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from bfrt.phases.intersection import intersect_all
from bfrt.phases.outliers import Outliers
from bfrt.phases.partition import partition_of
from bfrt.phases.preprocess import lattice_of, preprocess
from bfrt.phases.selection import Selections
from bfrt.phases.slabs import Slabs
from bfrt.phases.traversal import Flight, Ground
from bfrt.phases.voxel_rays import VoxelRays
from bfrt.settings import Settings
from bfrt.stats import Counters
from bfrt.store.marks import Marks
from bfrt.store.objects import Objects
from bfrt.store.store import Group, Store
from bfrt.workers import Workers

if TYPE_CHECKING:
    from bfrt.budget import Capacities


class Field:
    """One group, and the grid that memory has room for.

    Attributes
    ----------
    read : int
        Bytes that a pass reads: the most that one has.
    facts : dict
        What the counters tell of the grid.
    """

    def __init__(
        self,
        store: Store,
        group: Group,
        workers: Workers,
        capacities: Capacities,
        settings: Settings,
    ) -> None:
        refinement = settings.refinement
        self.objects = Objects(store, group, workers, capacities.read_buffer, refinement.lazy)
        self.read = 0
        self.marks_reused = False
        self.facts: dict[str, Any] = {}
        self._selections: Selections | None = None
        if refinement.hierarchy:
            self._selections = Selections(group.streams, workers.threads)
        self._store = store
        self._workers = workers
        self._capacities = capacities
        self._scratch = settings.scratch_beside(store.path)
        self._cut = partition_of(group, capacities.limits)
        self._lattice = lattice_of(store, group, self._cut.shape, self._cut.axis)
        self._outliers = Outliers(store, group)
        self._slabs: Slabs | None = None

    @property
    def selective(self) -> bool:
        """Whether a pass reads only what is near rays."""
        return self._selections is not None

    def preprocess(self, fresh: bool, counters: Counters) -> None:
        """See that there are marks."""
        marks, self.marks_reused = self._marks(fresh, counters)
        self.facts = {
            "voxels": list(self._cut.shape),
            "lower": 1 << self._cut.lower_bits,
            "bricks": int(marks.first[-1]),
            "slabs": len(Slabs.cuts(marks, self._capacities.limits.slab)) - 1,
        }
        marks.close()

    def _marks(self, fresh: bool, counters: Counters) -> tuple[Marks, bool]:
        return preprocess(
            self._store,
            self.objects,
            self._selections,
            self._lattice,
            self._cut,
            self._capacities.subspace,
            fresh=fresh,
            scratch=self._scratch,
            counters=counters,
        )

    def open(self) -> Ground:
        """Take memory for the grid."""
        marks, _ = self._marks(False, Counters())
        self._slabs = Slabs(self._lattice, marks, self._capacities.limits.slab, self._workers)
        voxel_rays = VoxelRays(self._cut.shape, self._cut.lower_bits, self._capacities.blocks)
        return Ground(self._slabs, voxel_rays, self._outliers)

    def intersect(self, flight: Flight, counters: Counters) -> None:
        """One pass over the group's objects."""
        before = counters.phases.intersection.bytes_read
        intersect_all(self.objects, self._selections, flight, counters)
        self.read = max(self.read, counters.phases.intersection.bytes_read - before)

    def close(self) -> None:
        """Close the marks."""
        if self._slabs is not None:
            self._slabs.close()
