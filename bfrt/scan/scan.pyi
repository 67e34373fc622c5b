from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from bfrt.scan.boxes import BoxCursor
from bfrt.scan.column import ColumnCursor
from bfrt.scan.files import StreamFiles
from bfrt.scan.geometry import GeometryCursor
from bfrt.store.stream import Stream

class StreamScan:
    boxes: BoxCursor
    geometry: GeometryCursor
    materials: ColumnCursor
    ids: ColumnCursor
    kind: int
    number: int
    lazy: bool
    deferred: bool
    def __init__(
        self,
        stream: Stream,
        origin: Sequence[float],
        files: StreamFiles,
        outliers: NDArray[np.int64],
        capacity: int,
    ) -> None: ...
    def rewind(self, prefetched: bool = False) -> None: ...
    def window(self, first: int, last: int) -> None: ...
    def pick(self, objects: NDArray[np.int64]) -> None: ...
    def counts(self) -> int: ...
