from typing import Any

import numpy as np
from numpy.typing import NDArray

from bfrt.scan.scan import StreamScan

def surfaces(
    scan: StreamScan,
    hits: NDArray[Any],
    ids: NDArray[np.uint64],
    columns: dict[str, NDArray[Any]],
    side: int,
) -> None: ...
