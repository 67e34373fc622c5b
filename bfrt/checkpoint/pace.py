"""When a state is saved: as often as is asked for, and no oftener than it may cost."""

from __future__ import annotations

import time

#: Of the time, what saving may take.
COST = 0.02

#: Bytes saved a second, until a save has been timed: those of a slow disk.
ASSUMED_RATE = 1e8

#: Seconds that a save may take where somebody waits for the work to end.
AT_ONCE = 0.5


class Pace:
    """Tells when the next save is due.

    Parameters
    ----------
    every : float
        Seconds between two saves at the least; 0 means at every occasion, whatever it costs.
    """

    def __init__(self, every: float) -> None:
        self.every = every
        self._rate = ASSUMED_RATE
        self._last = time.perf_counter()

    def due(self, size: int) -> bool:
        """Tell whether a state of `size` bytes is to be saved now."""
        if self.every == 0:
            return True
        return time.perf_counter() - self._last >= max(self.every, self.seconds(size) / COST)

    def at_once(self, size: int) -> bool:
        """Tell whether a state of `size` bytes is saved before anybody who waits would notice."""
        return self.seconds(size) <= AT_ONCE

    def seconds(self, size: int) -> float:
        """Estimate how long it takes to save `size` bytes."""
        return size / self._rate

    def saved(self, size: int, seconds: float) -> None:
        """Learn how long a save has taken."""
        self._rate = size / max(seconds, 1e-9)
        self._last = time.perf_counter()
