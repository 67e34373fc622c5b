import numpy as np
from numpy.typing import NDArray

from bfrt.grid.grid import Grid
from bfrt.grid.subspace import Subspace
from bfrt.scan.scan import StreamScan

def mark(
    scan: StreamScan,
    ranges: NDArray[np.int64],
    parents: NDArray[np.float32] | None,
    grid: Grid,
    subspace: Subspace,
    marks: NDArray[np.uint8],
) -> None: ...
