import enum

import numpy as np
import numpy.typing as npt

from bfrt.formats.text import Tokens

class Fault(enum.IntEnum):
    NO_NUMBER = 1
    FEW_NUMBERS = 2
    NO_INDEX = 3
    NO_VERTEX = 4
    FEW_CORNERS = 5
    MANY_CORNERS = 6
    BINARY = 7
    FAR_VERTEX = 8
    NO_NORMAL = 9

class Statement(enum.IntEnum):
    MATERIAL = 0
    LIBRARY = 1

class Lines(Tokens):
    vertices: int
    normals: int
    faces: int
    colored: int
    passed: int
    strokes: int
    unknown: int
    stranger: tuple[int, bytes]
    fault: int
    def __init__(self, of_faces: bool, fewest: int = 3, of_normals: bool = False) -> None: ...
    def parse(
        self, chunk: npt.NDArray[np.uint8]
    ) -> tuple[
        npt.NDArray[np.float64],
        npt.NDArray[np.int64],
        npt.NDArray[np.uint32],
        list[tuple[int, Statement, bytes]],
    ]: ...
