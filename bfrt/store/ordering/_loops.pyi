from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

MOST_BITS: int

def codes_of(
    boxes: NDArray[np.float32],
    low: Sequence[float] | NDArray[np.float64],
    scale: Sequence[float] | NDArray[np.float64],
    bits: int,
    codes: NDArray[np.uint64],
) -> None: ...
def gather(
    records: NDArray[np.uint8], stride: int, order: NDArray[np.uint32], out: NDArray[np.uint8]
) -> None: ...
def gather_runs(
    records: NDArray[np.uint8],
    stride: int,
    ends: NDArray[np.int64],
    order: NDArray[np.uint32],
    out: NDArray[np.uint8],
) -> None: ...
def give_back() -> None: ...
