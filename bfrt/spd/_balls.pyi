from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

CHILDREN: int

def grow(
    center: Sequence[float] | NDArray[np.float64],
    direction: Sequence[float] | NDArray[np.float64],
    radius: float,
    depth: int,
    offsets: NDArray[np.float64],
    records: NDArray[Any],
) -> None: ...
def children(
    center: Sequence[float] | NDArray[np.float64],
    direction: Sequence[float] | NDArray[np.float64],
    radius: float,
    offsets: NDArray[np.float64],
) -> tuple[NDArray[np.float64], NDArray[np.float64], float]: ...
