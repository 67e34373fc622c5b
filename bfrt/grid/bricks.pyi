import numpy as np
from numpy.typing import NDArray

Bytes = NDArray[np.uint8]

def pack(marks: Bytes, bricks: Bytes, occupied: Bytes) -> int: ...
