from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from bfrt.store.store import Stream
from bfrt.streams.reader import Tape

class Sweep:
    kind: int
    number: int
    tapes: tuple[Tape, ...]
    def __init__(
        self,
        stream: Stream,
        origin: Sequence[float],
        outliers: NDArray[np.int64],
        capacity: int,
        tapes: tuple[Tape, ...] | None = None,
        lazy: bool = False,
    ) -> None: ...
    def counts(self) -> int: ...
    def rewind(self, asked: bool = False) -> None: ...
    def ask(self, ranges: NDArray[np.int64]) -> None: ...
    def chosen(self, ranges: NDArray[np.int64], asked: bool) -> None: ...
    def picks(self, ranges: NDArray[np.int64]) -> None: ...
    def window(self, first: int, last: int) -> int: ...
    def material_window(self, first: int, last: int) -> int: ...
