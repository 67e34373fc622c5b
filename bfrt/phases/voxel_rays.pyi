import numpy as np
from numpy.typing import NDArray

from bfrt.workers import Workers

class VoxelRays:
    blocks: int
    given: int
    def __init__(
        self, shape: tuple[int, int, int], capacity: int, bits: int = 0, blocks: int = 0
    ) -> None: ...
    @property
    def slots(self) -> NDArray[np.uint64]: ...
    def sort(self, n: int, workers: Workers) -> None: ...
