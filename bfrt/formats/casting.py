"""Numbers of one type as another, without NumPy's warnings: what is wrong is refused later."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray


def cast(numbers: NDArray[Any], dtype: Any) -> NDArray[Any]:
    """Convert numbers to another dtype, silently.

    What is too large becomes infinite, and a NaN that signals is one that does not.
    """
    with np.errstate(over="ignore", invalid="ignore"):
        return numbers.astype(dtype, copy=False)
