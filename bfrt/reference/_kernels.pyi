from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from bfrt.grid.grid import Grid

def power(x: NDArray[np.float64], y: NDArray[np.float64]) -> NDArray[np.float64]: ...
def cosine_directions(
    normals: NDArray[np.float64], u: NDArray[np.float64], v: NDArray[np.float64]
) -> NDArray[np.float64]: ...
def spans(
    boxes: NDArray[np.float32],
    padding: float,
    origins: NDArray[np.float64],
    directions: NDArray[np.float64],
) -> NDArray[np.float64]: ...
def spans_of_eight(
    boxes: NDArray[np.float32],
    padding: float,
    origins: NDArray[np.float64],
    directions: NDArray[np.float64],
    reach: float = ...,
) -> NDArray[np.float64]: ...
def voxels_of_eight(
    boxes: NDArray[np.float32], grid: Grid
) -> tuple[NDArray[np.int32], NDArray[np.float32]]: ...
def decoded_eight(
    parent: NDArray[np.float32], codes: NDArray[np.uint8]
) -> tuple[NDArray[np.float32], NDArray[np.float32]]: ...
def entered_of_eight(
    regions: NDArray[np.int32], voxels: NDArray[np.int32], faces: NDArray[np.uint8]
) -> NDArray[np.uint8]: ...
def sphere_boxes(
    records: NDArray[np.uint8], wide: bool, origin: Sequence[float]
) -> tuple[NDArray[np.float32], NDArray[np.float32]]: ...
def meet(
    kind: int,
    record: NDArray[np.float64],
    origin: Sequence[float],
    padding: float,
    origins: NDArray[np.float64],
    directions: NDArray[np.float64],
) -> tuple[NDArray[np.float32], NDArray[np.float64], NDArray[np.float64], NDArray[np.int64]]: ...
