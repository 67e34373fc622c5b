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

Bytes = NDArray[np.uint8]

def pack(marks: Bytes, bricks: Bytes, occupied: Bytes) -> int: ...
