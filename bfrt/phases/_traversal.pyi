from typing import Any

import numpy as np
from numpy.typing import NDArray

from bfrt.geometry.lattice import Lattice
from bfrt.image.film import Film
from bfrt.phases.outliers import Outliers

def admit(
    queued: NDArray[Any],
    rays: NDArray[Any],
    paths: NDArray[Any],
    base: int,
    first: int,
    last: int,
    lattice: Lattice,
    marks: NDArray[np.uint8],
    outliers: Outliers,
) -> tuple[int, int, int, int]: ...
def collect(
    rays: NDArray[Any],
    first: int,
    last: int,
    lattice: Lattice,
    marks: NDArray[np.uint8],
    quota: int,
    slots: NDArray[np.uint64],
) -> tuple[int, int]: ...
def settle(
    rays: NDArray[Any],
    paths: NDArray[Any],
    first: int,
    last: int,
    lattice: Lattice,
    film: Film,
    background: NDArray[np.float64],
    hits: NDArray[Any],
) -> tuple[int, int, int]: ...
def close_ranks(
    rays: NDArray[Any],
    paths: NDArray[Any],
    base: int,
    firsts: NDArray[np.int64],
    counts: NDArray[np.int64],
) -> int: ...
