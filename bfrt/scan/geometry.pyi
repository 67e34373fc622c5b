from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from bfrt.scan.files import StreamFiles
from bfrt.store.stream import Stream

class GeometryCursor:
    kind: int
    number: int
    objects_read: int
    count: int
    def __init__(
        self, stream: Stream, origin: Sequence[float], files: StreamFiles, capacity: int
    ) -> None: ...
    def rewind(self, prefetched: bool = False) -> None: ...
    def window(self, first: int, last: int) -> int: ...
    def pick(self, objects: NDArray[np.int64]) -> None: ...
    def counts(self) -> int: ...
