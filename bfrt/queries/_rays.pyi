from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

class RayRecords:
    def __init__(self, origin: Sequence[float], bounds: NDArray[np.float64], kind: int) -> None: ...
    def fill(
        self,
        origins: NDArray[np.float64],
        directions: NDArray[np.float64],
        t_min: NDArray[np.float64],
        t_max: NDArray[np.float64],
        number: int,
        out: NDArray[Any],
    ) -> int: ...
