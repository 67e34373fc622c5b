from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

def node_of(boxes: NDArray[np.float32]) -> NDArray[np.uint8]: ...
def node_sides(memory: NDArray[np.uint8]) -> NDArray[np.float64]: ...
def node_met(
    memory: NDArray[np.uint8],
    around: NDArray[np.float32],
    ray: tuple[Sequence[float], Sequence[float]],
    grow: float,
    reach: float,
    plain: bool,
) -> tuple[int, NDArray[np.float64]]: ...
def box_met(
    box: NDArray[np.float32], origin: Sequence[float], direction: Sequence[float], grow: float
) -> tuple[float, float] | None: ...
def drawn(
    nodes: NDArray[np.uint8], objects: int, most: int
) -> tuple[NDArray[np.uint8], NDArray[np.uint16]] | None: ...

class TopTree:
    def __init__(
        self,
        nodes: NDArray[np.uint8],
        leaves: NDArray[np.uint32],
        boxes: NDArray[np.float32],
        plain: bool,
        padding: float = 0.0,
    ) -> None: ...
    def next(
        self,
        ray: tuple[Sequence[float], Sequence[float]],
        first: tuple[float, int],
        reach: float,
        most: int,
    ) -> list[tuple[float, int]]: ...
