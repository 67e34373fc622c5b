from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

def lines(
    kinds: Sequence[int],
    columns: Sequence[NDArray[np.float64]],
    starts: Sequence[NDArray[np.int64]],
    owner: NDArray[np.int64],
    index: NDArray[np.int64],
    materials: NDArray[np.uint32],
    fills: Sequence[bytes],
    current: int,
) -> bytes: ...
