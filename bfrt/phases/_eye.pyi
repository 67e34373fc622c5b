from typing import Any

import numpy as np
from numpy.typing import NDArray

class EyeRayGenerator:
    def __init__(
        self,
        views: NDArray[np.float64],
        width: int,
        height: int,
        samples: int,
        turn: int,
        bounds: NDArray[np.float64],
    ) -> None: ...
    def take_rows(self, rows: NDArray[np.uint32]) -> None: ...
    def generate(self, first: int, out: NDArray[Any]) -> None: ...
    def centers(self, first: int, out: NDArray[np.float64]) -> None: ...
