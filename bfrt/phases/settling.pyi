from typing import Any

import numpy as np
from numpy.typing import NDArray

from bfrt.image.film import Film

def set_out(queued: NDArray[Any], rays: NDArray[Any]) -> int: ...
def settle(rays: NDArray[Any], film: Film, background: NDArray[np.float64]) -> tuple[int, int]: ...
