import numpy as np
from numpy.typing import NDArray

from bfrt.geometry.lattice import Lattice
from bfrt.scene.sweep import Sweep

def mark(sweep: Sweep, n: int, lattice: Lattice, marks: NDArray[np.uint8]) -> None: ...
def darken(marks: NDArray[np.uint8], lattice: Lattice, first: int, last: int) -> None: ...
