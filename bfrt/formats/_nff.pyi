import enum

import numpy as np
import numpy.typing as npt

from bfrt.formats.text import Tokens
from bfrt.records import Kind

MAX_TOKEN: int
MAX_RESOLUTION: int

class Event(enum.IntEnum):
    HUNGRY = 0
    DONE = 1
    FAULT = 2
    CAMERA = 3
    LIGHT = 4
    BACKGROUND = 5
    MATERIAL = 6
    UNPAINTED = 7
    BLOCK_FULL = 8

class Fault(enum.IntEnum):
    CUT_SHORT = 1
    BINARY = 2
    TOO_LONG = 3
    NOT_A_NUMBER = 4
    NOT_FINITE = 5
    NOT_AN_INTEGER = 6
    NEGATIVE = 7
    MIXED_RADII = 8
    UNKNOWN_KEYWORD = 9
    SECOND_VIEW = 10
    SECOND_FIELD = 11
    MISSING_FIELD = 12

class Entity(enum.IntEnum):
    VIEW_FROM = 0
    VIEW_AT = 1
    VIEW_UP = 2
    VIEW_ANGLE = 3
    VIEW_HITHER = 4
    VIEW_RESOLUTION = 5
    BACKGROUND_COLOR = 6
    LIGHT_POSITION = 7
    LIGHT_COLOR = 8
    MATERIAL_COLOR = 9
    MATERIAL_REST = 10
    SPHERE = 11
    CONE = 12
    POLYGON_COUNT = 13
    TRIANGLE = 14
    POLYGON_VERTEX = 15
    PATCH_COUNT = 16
    PATCH_VERTEX = 17

class Parser(Tokens):
    have: int
    entity: int
    vertex: int
    seen: int
    view_line: int
    fault: int
    kind: int

    def __init__(self, chunk_bytes: int, block_objects: int) -> None: ...
    def feed(self, chunk: bytes) -> None: ...
    def advance(self) -> int: ...
    def paint_with(self, material: int) -> None: ...
    def take(self, kind: Kind) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.uint32]]: ...
    def take_polygons(
        self,
    ) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.int64], npt.NDArray[np.uint32]]: ...
    @property
    def values(self) -> tuple[float, ...]: ...
    @property
    def view(self) -> tuple[float, ...]: ...
    @property
    def awaits_number(self) -> bool: ...
