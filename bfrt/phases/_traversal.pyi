from typing import Any

import numpy as np
from numpy.typing import NDArray

from bfrt.grid.grid import Grid
from bfrt.grid.slabs import Slabs
from bfrt.grid.voxel_rays import VoxelRays
from bfrt.image.film import Film
from bfrt.phases.in_flight import RaysInFlight
from bfrt.phases.outliers import Outliers

class RayPool(RaysInFlight):
    def __init__(self, capacity: int, candidates: int) -> None: ...
    @property
    def in_flight(self) -> NDArray[Any]: ...
    @property
    def room(self) -> NDArray[np.uint64]: ...
    @property
    def stored(self) -> int: ...
    def enter_grid(self) -> None: ...
    def admit(
        self,
        queued: NDArray[Any],
        first: int,
        last: int,
        grid: Grid,
        outliers: Outliers | None,
    ) -> tuple[int, int, int]: ...
    def admit_again(
        self,
        partial: NDArray[Any],
        first: int,
        last: int,
        grid: Grid,
        outliers: Outliers | None,
    ) -> tuple[int, int, int]: ...
    def begin_walk(self, base: int, each: int) -> None: ...
    def keep_order(self) -> None: ...
    def arrange(self, first: int, slabs: Slabs, starts: NDArray[np.int64]) -> None: ...
    def walk(
        self, first: int, last: int, slabs: Slabs, voxel_rays: VoxelRays
    ) -> tuple[int, int, int]: ...
    def close_up(self, firsts: NDArray[np.int64], counts: NDArray[np.int64], end: int) -> int: ...
    def retire(
        self,
        first: int,
        last: int,
        grid: Grid,
        film: Film | None,
        background: NDArray[np.float64],
        hits: NDArray[Any],
    ) -> tuple[int, int, int]: ...
