import numpy as np
from numpy.typing import NDArray

from bfrt.geometry.lattice import Lattice
from bfrt.phases.subspace import Subspace
from bfrt.scan.scan import StreamScan

def mark(
    scan: StreamScan,
    ranges: NDArray[np.int64],
    parents: NDArray[np.float32] | None,
    lattice: Lattice,
    subspace: Subspace,
    marks: NDArray[np.uint8],
) -> None: ...
