from typing import Any

from numpy.typing import NDArray

class Film:
    shape: tuple[int, int]
    samples: int
    corners: bool
    def __init__(self, width: int, height: int, samples: int) -> None: ...
    def rows(self, first: int, last: int) -> dict[str, NDArray[Any]]: ...
