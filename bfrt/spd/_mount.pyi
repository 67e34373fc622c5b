from typing import Any

import numpy as np
from numpy.typing import NDArray

def halve(
    z: NDArray[np.float64],
    x: int,
    y: int,
    side: int,
    rise: float,
    size: int,
    jenkins: bool,
    deviates: NDArray[np.float64],
    finer: NDArray[np.float64],
) -> None: ...
def triangles(
    z: NDArray[np.float64],
    xs: NDArray[np.float64],
    ys: NDArray[np.float64],
    records: NDArray[Any],
) -> None: ...
