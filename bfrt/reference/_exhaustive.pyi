import numpy as np
from numpy.typing import NDArray

from bfrt.scan.geometry import GeometryCursor

LINE_DOUBLES: int

def scale_directions(directions: NDArray[np.float64], powers: NDArray[np.int32]) -> None: ...
def bring_near(
    origins: NDArray[np.float64],
    directions: NDArray[np.float64],
    bounds: NDArray[np.float64],
    moved: NDArray[np.float64],
) -> None: ...
def lines(
    origins: NDArray[np.float64], directions: NDArray[np.float64], out: NDArray[np.float64]
) -> None: ...
def meet(
    cursor: GeometryCursor,
    objects: NDArray[np.uint64],
    padding: float,
    rays: NDArray[np.float64],
    t: NDArray[np.float64],
    ids: NDArray[np.uint64],
) -> None: ...
def cross(
    cursor: GeometryCursor,
    objects: NDArray[np.uint64],
    padding: float,
    rays: NDArray[np.float64],
    found: list[tuple[int, float, int]],
) -> None: ...
