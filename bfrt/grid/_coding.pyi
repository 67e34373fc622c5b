import numpy as np
from numpy.typing import NDArray

from bfrt.streams.reader import Reader

MOST_CODED: int

def encode(bricks: NDArray[np.uint8], out: NDArray[np.uint8]) -> int: ...
def decode(reader: Reader, bricks: NDArray[np.uint8]) -> None: ...
