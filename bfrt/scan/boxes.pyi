from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from bfrt.scan.files import StreamFiles
from bfrt.store.stream import Stream

class BoxCursor:
    coded: bool
    number: int
    def __init__(
        self,
        stream: Stream,
        origin: Sequence[float],
        files: StreamFiles,
        outliers: NDArray[np.int64],
        capacity: int,
    ) -> None: ...
    def rewind(self, prefetched: bool = False) -> None: ...
    def prefetch(self, ranges: NDArray[np.int64]) -> None: ...
    def choose(self, ranges: NDArray[np.int64], prefetched: bool) -> None: ...
    def window(self, first: int, last: int) -> int: ...
