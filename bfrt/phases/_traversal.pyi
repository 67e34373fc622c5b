from typing import Any

import numpy as np
from numpy.typing import NDArray

from bfrt.geometry.lattice import Lattice
from bfrt.image.film import Film
from bfrt.phases.outliers import Outliers
from bfrt.phases.voxel_rays import VoxelRays

def admit(
    queued: NDArray[Any],
    rays: NDArray[Any],
    paths: NDArray[Any],
    base: int,
    first: int,
    last: int,
    lattice: Lattice,
    outliers: Outliers | None,
) -> tuple[int, int, int]: ...
def admit_again(
    partial: NDArray[Any],
    rays: NDArray[Any],
    paths: NDArray[Any],
    base: int,
    first: int,
    last: int,
    lattice: Lattice,
    outliers: Outliers | None,
) -> tuple[int, int, int]: ...
def arrange(
    rays: NDArray[Any],
    first: int,
    lattice: Lattice,
    slab_of_layer: NDArray[np.int32],
    starts: NDArray[np.int64],
    order: NDArray[np.uint32],
) -> None: ...
def walk(
    rays: NDArray[Any],
    order: NDArray[np.uint32],
    first: int,
    last: int,
    lattice: Lattice,
    slab: int,
    bricks: NDArray[np.uint8],
    first_brick: int,
    table: NDArray[np.int32],
    slab_of_layer: NDArray[np.int32],
    left: NDArray[np.uint32],
    voxel_rays: VoxelRays,
    slots: NDArray[np.uint64],
    used: NDArray[np.int64],
) -> tuple[int, int, int]: ...
def close_up(
    order: NDArray[np.uint32], firsts: NDArray[np.int64], counts: NDArray[np.int64], end: int
) -> int: ...
def settle(
    rays: NDArray[Any],
    paths: NDArray[Any],
    first: int,
    last: int,
    lattice: Lattice,
    film: Film | None,
    background: NDArray[np.float64],
    hits: NDArray[Any],
    last_group: bool = True,
) -> tuple[int, int, int]: ...
def close_ranks(
    rays: NDArray[Any],
    paths: NDArray[Any],
    base: int,
    firsts: NDArray[np.int64],
    counts: NDArray[np.int64],
) -> int: ...
