import numpy as np
import numpy.typing as npt

def meet(
    points: npt.NDArray[np.float64],
    sample: npt.NDArray[np.float64],
    nearest: npt.NDArray[np.float64],
) -> None: ...
