from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

def lines(
    columns: Sequence[tuple[int, NDArray[np.float64], NDArray[np.int64]]],
    owner: NDArray[np.int64],
    index: NDArray[np.int64],
    materials: NDArray[np.uint32],
    fills: Sequence[bytes],
) -> bytes: ...
