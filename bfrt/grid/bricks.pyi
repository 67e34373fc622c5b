import numpy as np
from numpy.typing import NDArray

DARK_SHIFT: int
DARK: int
BRICK_SHIFT: int
BRICK: int
BRICK_BYTES: int
EMPTY_BRICK: int
CUBE_SHIFT: int
EMPTY_CUBE: int

def pack(
    marks: NDArray[np.uint8], bricks: NDArray[np.uint8], occupied: NDArray[np.uint8]
) -> int: ...
