from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from bfrt.image.film import Film
from bfrt.scan.scan import StreamScan

class Shader:
    reflection: int
    refraction: int
    shadow: int
    def __init__(
        self,
        palette: NDArray[Any],
        lights: NDArray[np.float64],
        ambient: float,
        eye: ArrayLike,
        origin: ArrayLike,
        film: Film,
        out: NDArray[Any],
        emit: Callable[[NDArray[Any]], None],
    ) -> None: ...
    def shade(self, scan: StreamScan, n: int, hits: NDArray[Any], last: bool) -> None: ...
    def shade_picked(self, scan: StreamScan, hits: NDArray[Any], last: bool) -> None: ...
    def flush(self) -> None: ...
