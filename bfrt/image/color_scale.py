"""What colors say: the numbers that a map makes colors of, from the least to the greatest."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from bfrt.image.colormaps import STEPS

#: Bits of a step's number.
BITS = STEPS.bit_length() - 1


class ColorScale(NamedTuple):
    """Says which colors numbers have.

    Attributes
    ----------
    name : str
        What the numbers are called, as the caller of a conversion has named them.
    colormap : str
        The map.
    lo, hi : float
        The numbers that get its first and its last color; those beyond get these too.
    log : bool
        Whether equal ratios are equal steps; numbers of 0 and below have no color then.
    """

    name: str
    colormap: str
    lo: float
    hi: float
    log: bool = False

    def steps(self, values: NDArray[Any]) -> NDArray[np.int64]:
        """Return the step of each number (n,), 0 to STEPS - 1; STEPS where it has no color."""
        return self._ratios(values) if self.log else self._parts(values)

    def _parts(self, values: NDArray[Any]) -> NDArray[np.int64]:
        span = self.hi - self.lo
        with np.errstate(all="ignore"):
            above = values.astype(np.float64) - self.lo
            step = np.clip(above / span * STEPS if span > 0 else above * 0.0, 0, STEPS - 1)
        return np.where(~np.isnan(step), step, STEPS).astype(np.int64)

    def _ratios(self, values: NDArray[Any]) -> NDArray[np.int64]:
        numbers = values.astype(np.float64)
        found = np.searchsorted(self.borders(), numbers, side="right")
        with np.errstate(invalid="ignore"):
            return np.where(numbers > 0.0, found, STEPS)

    def borders(self) -> NDArray[np.float64]:
        """Return where the steps 1, 2, ... of a logarithmic scale begin, (STEPS - 1,).

        They are made by square roots and products, which are the same on every processor.
        """
        fourth = math.sqrt(math.sqrt(self.hi)) / math.sqrt(math.sqrt(self.lo))
        powers = [fourth, fourth]  # of the ratio of the ends: a half is two, each a quarter
        powers.append(fourth)
        for _ in range(BITS - 2):
            powers.append(math.sqrt(powers[-1]))
        numbers = np.arange(1, STEPS)
        found = np.full(STEPS - 1, self.lo)
        for power, bit in zip(powers, (BITS - 1, *range(BITS - 1, -1, -1)), strict=True):
            found = np.where(numbers >> bit & 1, found * power, found)
        return np.maximum.accumulate(found)
