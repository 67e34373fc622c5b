from typing import Any

import numpy as np
from numpy.typing import NDArray

from bfrt.grid.grid import Grid
from bfrt.grid.voxel_rays import VoxelRays
from bfrt.phases.crossings import CrossingBuffer
from bfrt.scan.given_order import GivenOrder
from bfrt.scan.scan import StreamScan

class Intersector:
    def __init__(self, grid: Grid, voxel_rays: VoxelRays, order: GivenOrder) -> None: ...
    def begin(self, rays: NDArray[Any], crossings: CrossingBuffer | None = None) -> None: ...
    def meet(
        self,
        scan: StreamScan,
        ranges: NDArray[np.int64],
        parents: NDArray[np.float32] | None = None,
    ) -> None: ...
    def finish(self, scan: StreamScan) -> None: ...
    def tests(self) -> tuple[int, int]: ...
