from typing import Any

import numpy as np
from numpy.typing import NDArray

TREELET_OBJECTS: int
LEAF_OBJECTS: int

class TreeletBuilder:
    def __init__(self, most: int = ..., leaf: int = ...) -> None: ...
    def build(
        self, boxes: NDArray[np.float32]
    ) -> tuple[NDArray[Any], NDArray[Any], NDArray[np.uint32]]: ...
