"""Masks of NumPy's masked arrays: an element without a value is no number to go on with."""

from __future__ import annotations

import sys
from typing import Any

import numpy as np


def is_masked(value: Any) -> bool:
    """Tell whether an element of an array, or of the arrays in a list, is masked.

    What makes a plain array of them drops the mask, and goes on with what is below.
    """
    if "numpy.ma" not in sys.modules:  # nobody has made one; NumPy imports it at first use
        return False
    if isinstance(value, (list, tuple)):
        return any(
            isinstance(part, (list, tuple, np.ma.MaskedArray)) and is_masked(part) for part in value
        )
    return bool(np.ma.is_masked(value))
