from typing import Any

import numpy as np
from numpy.typing import NDArray

def eye_rays(
    first: int,
    out: NDArray[Any],
    view: NDArray[np.float64],
    width: int,
    height: int,
    samples: int,
    turn: int,
    bounds: NDArray[np.float64],
) -> None: ...
