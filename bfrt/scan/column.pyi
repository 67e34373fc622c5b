import numpy as np
from numpy.typing import NDArray

from bfrt.scan.files import StreamFiles

class ColumnCursor:
    def __init__(
        self,
        files: StreamFiles,
        name: str,
        bytes: int,
        capacity: int,
        one: int | None = None,
        base: int = 0,
    ) -> None: ...
    def rewind(self, prefetched: bool = False) -> None: ...
    def window(self, first: int, last: int) -> None: ...
    def pick(self, objects: NDArray[np.int64]) -> None: ...
