from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

class Grid:
    tables: list[NDArray[np.float64]]
    shape: tuple[int, int, int]
    order: tuple[int, int, int]
    padding: float
    def __init__(
        self, lo: ArrayLike, hi: ArrayLike, shape: Sequence[int], padding: float, axis: int = 2
    ) -> None: ...
    @property
    def layered(self) -> tuple[int, int, int]: ...
    @property
    def voxels(self) -> int: ...
    def range_of(self, box: ArrayLike) -> tuple[tuple[int, int, int], tuple[int, int, int]]: ...
    def walk(
        self,
        origin: ArrayLike,
        direction: ArrayLike,
        voxel: int = ...,
        face: int = ...,
        shift: int = ...,
    ) -> list[tuple[int, int, float]]: ...
