from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

LARGEST: int

class LargestBoxes:
    def add(self, boxes: NDArray[np.float32], first: int) -> None: ...
    @property
    def ids(self) -> NDArray[np.uint64]: ...
    @property
    def boxes(self) -> NDArray[np.float32]: ...
    @property
    def rest(self) -> NDArray[np.float64]: ...

def bound(
    kind: int,
    records: NDArray[Any],
    counts: NDArray[np.uint32],
    origin: Sequence[float],
    boxes: NDArray[np.float32],
) -> tuple[int, int]: ...
def around(boxes: NDArray[np.float32]) -> NDArray[np.float64]: ...
def around_points(points: NDArray[np.float32]) -> NDArray[np.float64]: ...
