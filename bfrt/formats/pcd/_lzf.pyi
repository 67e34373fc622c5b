import numpy as np
import numpy.typing as npt

FEED_BYTES: int

class Unpacker:
    failed: bool
    def feed(self, piece: bytes) -> None: ...
    def take(self, out: npt.NDArray[np.uint8]) -> int: ...
