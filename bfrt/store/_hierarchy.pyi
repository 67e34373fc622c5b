from typing import Any

import numpy as np
from numpy.typing import NDArray

MOST_LEVELS: int

class Merger:
    def __init__(self, limit: float, most: int, least: int = 1) -> None: ...
    def merge(self, boxes: NDArray[np.float32], out: NDArray[Any]) -> int: ...
    def finish(self, out: NDArray[Any]) -> int: ...

def quantise(
    boxes: NDArray[np.float32], parents: NDArray[Any], first: int, codes: NDArray[np.uint8]
) -> None: ...
