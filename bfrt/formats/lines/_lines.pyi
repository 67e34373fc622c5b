import enum
from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from bfrt.formats.text import Tokens

MOST_COLUMNS: int

class Fault(enum.IntEnum):
    NO_NUMBER = 1
    OTHER_COLUMNS = 2

class Lines(Tokens):
    rows: int
    def __init__(self, line: int, most: int) -> None: ...
    @property
    def done(self) -> bool: ...

class Columns(Lines):
    fault: int
    found: int
    def __init__(
        self, places: Sequence[int], width: int, separator: bytes, line: int, most: int
    ) -> None: ...
    def parse(self, chunk: npt.NDArray[np.uint8]) -> tuple[npt.NDArray[np.float64], int]: ...

class Ragged(Lines):
    failed: bool
    def __init__(self, line: int, most: int) -> None: ...
    def parse(
        self, chunk: npt.NDArray[np.uint8]
    ) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.uint32], npt.NDArray[np.int64], int]: ...
