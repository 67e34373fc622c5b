import enum
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

class Spread(enum.IntEnum):
    AROUND = 0
    UNIFORM = 1
    COSINE = 2

class Outlook:
    def __init__(
        self, rays: int, spread: Spread, origin: Sequence[float], bounds: NDArray[np.float64]
    ) -> None: ...
    def fill(
        self,
        first: int,
        points: NDArray[np.float64],
        normals: NDArray[np.float64],
        origins: NDArray[np.float64],
        directions: NDArray[np.float64],
    ) -> None: ...
