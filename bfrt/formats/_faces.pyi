import enum
from typing import Any

import numpy as np
import numpy.typing as npt

class Cut(enum.IntEnum):
    RIGHT = 0
    CROSSING = 1
    EARS = 2

def bent(
    corners: npt.NDArray[Any], counts: npt.NDArray[np.uint32], part: float, rounding: float
) -> npt.NDArray[np.bool_]: ...
def cut(
    corners: npt.NDArray[Any],
    counts: npt.NDArray[np.uint32],
    triangles: npt.NDArray[np.int64],
    cuts: npt.NDArray[np.uint8],
    outlines: npt.NDArray[np.float64],
) -> None: ...
