from collections.abc import Callable
from typing import Any

from numpy.typing import NDArray

class CrossingBuffer:
    def __init__(self, room: int, emit: Callable[[NDArray[Any]], None]) -> None: ...
