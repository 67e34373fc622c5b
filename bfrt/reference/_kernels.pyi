from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

def power(x: NDArray[np.float64], y: NDArray[np.float64]) -> NDArray[np.float64]: ...
def spans(
    boxes: NDArray[np.float32],
    grow: float,
    origins: NDArray[np.float64],
    directions: NDArray[np.float64],
) -> NDArray[np.float64]: ...
def meet(
    kind: int,
    record: NDArray[np.float64],
    origin: Sequence[float],
    grow: float,
    origins: NDArray[np.float64],
    directions: NDArray[np.float64],
) -> tuple[NDArray[np.float32], NDArray[np.float64], NDArray[np.float64]]: ...
