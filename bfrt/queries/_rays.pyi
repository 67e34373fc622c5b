from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bfrt.scan.scan import StreamScan

def ask(
    origins: NDArray[np.float64],
    directions: NDArray[np.float64],
    t_min: NDArray[np.float64],
    t_max: NDArray[np.float64],
    origin: Sequence[float],
    bounds: NDArray[np.float64],
    first: int,
    kind: int,
    out: NDArray[Any],
) -> int: ...
def surfaces(
    scan: StreamScan, hits: NDArray[Any], normals: NDArray[np.float32], uvs: NDArray[np.float32]
) -> None: ...
