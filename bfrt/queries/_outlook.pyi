from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

class Outlook:
    def __init__(
        self, rays: int, spread: int, origin: Sequence[float], bounds: NDArray[np.float64]
    ) -> None: ...
    def fill(
        self,
        first: int,
        points: NDArray[np.float64],
        normals: NDArray[np.float64],
        origins: NDArray[np.float64],
        directions: NDArray[np.float64],
    ) -> None: ...
