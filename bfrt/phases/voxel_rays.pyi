import numpy as np
from numpy.typing import NDArray

from bfrt.workers import Workers

class VoxelRays:
    def __init__(self, shape: tuple[int, int, int], capacity: int) -> None: ...
    @property
    def slots(self) -> NDArray[np.uint64]: ...
    def sort(
        self, firsts: NDArray[np.int64], counts: NDArray[np.int64], workers: Workers
    ) -> None: ...
