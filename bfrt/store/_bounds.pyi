from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

def bound(
    kind: int,
    geometry: NDArray[np.uint8],
    counts: NDArray[np.uint32],
    wide: bool,
    origin: Sequence[float],
    scalars: int,
    boxes: NDArray[np.float32],
) -> tuple[int, int]: ...
def gather(
    boxes: NDArray[np.float32],
    first: int,
    rest: NDArray[np.float64],
    sizes: NDArray[np.float64],
    largest: NDArray[np.float32],
    largest_ids: NDArray[np.uint64],
    count: int,
) -> int: ...
