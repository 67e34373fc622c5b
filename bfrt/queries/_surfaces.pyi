from typing import Any

import numpy as np
from numpy.typing import NDArray

from bfrt.scan.scan import StreamScan

def surfaces(
    scan: StreamScan,
    hits: NDArray[Any],
    ids: NDArray[np.uint64],
    normals: NDArray[np.float32],
    uvs: NDArray[np.float32],
) -> None: ...
