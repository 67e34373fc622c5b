from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

class Film:
    shape: tuple[int, int]
    samples: int
    views: int
    corners: bool
    row: int
    held: int
    def __init__(
        self,
        width: int,
        height: int,
        samples: int,
        held: int | None = None,
        aovs: Sequence[str] = (),
        views: int = 1,
    ) -> None: ...
    def number(self, numbers: NDArray[np.uint32]) -> None: ...
    @property
    def end(self) -> int: ...
    def planes(self) -> list[tuple[NDArray[Any], Any]]: ...
    def clear(self, kept: int) -> None: ...
    def elements(self) -> tuple[int, int]: ...
    def advance(self) -> None: ...
    def begin_at(self, row: int) -> None: ...
    def rows(self, first: int, last: int, view: int = 0) -> dict[str, NDArray[Any]]: ...
