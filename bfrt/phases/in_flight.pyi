from typing import Any

import numpy as np
from numpy.typing import NDArray

RAY_WORDS: int

class RaysInFlight:
    active: int
    capacity: int
    def __init__(self, capacity: int, words: int) -> None: ...
    @property
    def all(self) -> tuple[NDArray[Any], NDArray[Any]]: ...
    def come(self, n: int) -> None: ...
    def compact(self, base: int, firsts: NDArray[np.int64], counts: NDArray[np.int64]) -> None: ...
