import numpy as np
from numpy.typing import NDArray

from bfrt.workers import Workers

UPPER_BYTES: float
BLOCK_BYTES: int

class VoxelRays:
    blocks: int
    given: int
    def __init__(self, shape: tuple[int, int, int], bits: int = 0, blocks: int = 0) -> None: ...
    @staticmethod
    def bytes(uppers: int, blocks: int) -> int: ...
    def sort(self, slots: NDArray[np.uint64], n: int, workers: Workers) -> None: ...
