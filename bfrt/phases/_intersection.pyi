from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bfrt.geometry.lattice import Lattice
from bfrt.phases.delays import Delays
from bfrt.phases.voxel_rays import VoxelRays
from bfrt.store.sweep import Sweep

def intersect(
    sweep: Sweep,
    ranges: NDArray[np.int64],
    parents: NDArray[np.float32] | None,
    delays: Delays,
    lattice: Lattice,
    voxel_rays: VoxelRays,
    rays: NDArray[Any],
    crossings: NDArray[Any] | None = None,
    emit: Callable[[int], None] | None = None,
) -> tuple[int, int]: ...
def settle(
    sweep: Sweep,
    delays: Delays,
    lattice: Lattice,
    rays: NDArray[Any],
    crossings: NDArray[Any] | None = None,
    emit: Callable[[int], None] | None = None,
) -> int: ...
