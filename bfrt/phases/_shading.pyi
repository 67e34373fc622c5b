from collections.abc import Callable
from typing import Any

from numpy.typing import ArrayLike, NDArray

from bfrt.image.film import Film
from bfrt.phases.lighting import Lighting
from bfrt.phases.viewpoints import Viewpoints
from bfrt.scan.scan import StreamScan

GATHERED: int

class Shader:
    reflection: int
    refraction: int
    shadow: int
    def __init__(
        self,
        palette: NDArray[Any],
        lighting: Lighting,
        viewpoints: Viewpoints,
        origin: ArrayLike,
        film: Film,
    ) -> None: ...
    def begin(self, emit: Callable[[NDArray[Any]], None], last: bool) -> None: ...
    def shade(self, scan: StreamScan, n: int, hits: NDArray[Any]) -> None: ...
    def shade_picked(self, scan: StreamScan, hits: NDArray[Any]) -> None: ...
    def flush(self) -> None: ...
