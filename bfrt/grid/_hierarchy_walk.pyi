import numpy as np
from numpy.typing import NDArray

from bfrt.grid.grid import Grid
from bfrt.grid.subspace import Subspace
from bfrt.grid.voxel_rays import VoxelRays
from bfrt.store.stream import Stream

class HierarchyWalk:
    def __init__(self, stream: Stream, capacity: int) -> None: ...
    def begin(self, grid: Grid, where: VoxelRays | Subspace) -> None: ...
    def choose(
        self,
        ranges: NDArray[np.int64],
        objects: int,
        parents: NDArray[np.float32] | None = None,
    ) -> int: ...
    def counts_read(self) -> tuple[int, int, int]: ...
