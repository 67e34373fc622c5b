"""The objects that a pass looks at: all, or those whose parents in the hierarchy are near its rays
or its subspace."""

from __future__ import annotations

from bfrt.grid._hierarchy_walk import HierarchyWalk
from bfrt.grid.grid import Grid
from bfrt.grid.subspace import Subspace
from bfrt.grid.voxel_rays import VoxelRays
from bfrt.scan.scans import GroupScans
from bfrt.scan.sources import FEWEST, AllObjects, Batches, ChosenObjects
from bfrt.stats import Phase
from bfrt.store.store import Store
from bfrt.store.stream import Stream

#: Bytes of a level's read buffer.
LEVEL_BUFFER = 1 << 16

#: What objects are near: the voxels that hold rays, or those of a subspace.
Where = VoxelRays | Subspace


class Selection:
    """Selects the objects of a group that a pass looks at, stream by stream.

    Parameters
    ----------
    scans : GroupScans
    threads : int
    hierarchy : bool
        Whether only those are looked at that are near what the pass is about.
    """

    def __init__(self, scans: GroupScans, threads: int, hierarchy: bool) -> None:
        self.hierarchy = hierarchy
        self._scans = scans
        self._walks: dict[int, HierarchyWalk] = {}
        if hierarchy:
            self._batches = Batches(threads)
            self._walks = {
                s.number: HierarchyWalk(s, LEVEL_BUFFER) for s in scans.streams if s.levels
            }

    @staticmethod
    def bytes(store: Store, threads: int) -> int:
        """Return the bytes of the levels' read buffers, and of the ranges that are chosen ahead."""
        levels = sum(len(stream.levels) for stream in store.streams) * LEVEL_BUFFER
        return levels + len(store.groups) * Batches.bytes(threads)

    def near(
        self, stream: Stream, grid: Grid, where: Where, fewest: int = FEWEST
    ) -> AllObjects | ChosenObjects:
        """Return the source of the objects of a stream that are near `where`, or of all.

        A worker gets `fewest` of them at a time, or more.
        """
        if stream.number not in self._walks:
            return AllObjects(self._scans, stream)
        walk = self._walks[stream.number]
        walk.begin(grid, where)
        return ChosenObjects(self._scans, stream, walk, self._batches, fewest)

    def count(self, phase: Phase) -> int:
        """Add the bytes and seeks of walks to a phase; return the boxes read."""
        counts = [walk.counts_read() for walk in self._walks.values()]
        phase.bytes_read += sum(c[1] for c in counts)
        phase.seeks += sum(c[2] for c in counts)
        return sum(c[0] for c in counts)
