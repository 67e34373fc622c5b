import enum
from typing import Any

import numpy as np
import numpy.typing as npt

from bfrt.formats.ply.element import Element, Wanted
from bfrt.formats.text import Tokens

MOST_PROPERTIES: int

class Fault(enum.IntEnum):
    BAD_NUMBER = 1
    NEGATIVE_COUNT = 2
    NO_INDEX = 3
    LONG_FACE = 4

class Rows(Tokens):
    row: int
    fault: int
    found: float
    def __init__(self, element: Element, wanted: Wanted, layout: str, line: int) -> None: ...
    @property
    def done(self) -> bool: ...
    def parse(
        self, chunk: npt.NDArray[np.uint8]
    ) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.uint32], npt.NDArray[Any], int]: ...
