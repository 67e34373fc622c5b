from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from bfrt.scene.store import Stream
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
    def rewind(self) -> None: ...
    def expect(self, apart: float) -> None: ...
    def window(self, first: int, last: int) -> int: ...
    def material_window(self, first: int, last: int) -> int: ...
