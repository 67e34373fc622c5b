from typing import Any

import numpy as np
from numpy.typing import NDArray

class Noise:
    def __init__(self, size: int, jenkins: bool, deviates: NDArray[np.float64]) -> None: ...
    def halve(
        self,
        z: NDArray[np.float64],
        x: int,
        y: int,
        side: int,
        rise: float,
        finer: NDArray[np.float64],
    ) -> None: ...

def triangles(
    z: NDArray[np.float64],
    xs: NDArray[np.float64],
    ys: NDArray[np.float64],
    records: NDArray[Any],
) -> None: ...
