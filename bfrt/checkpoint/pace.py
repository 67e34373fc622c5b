"""When a state is saved: as often as is asked for, and no oftener than it may cost."""

from __future__ import annotations

import time

#: Of the time, what saving may take.
COST = 0.02

#: Seconds of each save, and bytes saved a second, until saves have been timed: of a slow disk.
ASSUMED_EACH = 0.1
ASSUMED_RATE = 1e8

#: Bytes of a save whose time tells the rate.
LARGE = 1 << 24

#: Seconds that a save may take where somebody waits for the work to end.
AT_ONCE = 0.5


class Pace:
    """Tells when the next save is due.

    Parameters
    ----------
    every : float
        Seconds between two saves at the least; 0 means at every occasion, whatever it costs.
    each : float
        Seconds of each save, until one has been timed.
    """

    def __init__(self, every: float, each: float = ASSUMED_EACH) -> None:
        self.every = every
        self._each, self._rate = each, ASSUMED_RATE
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
        return self._each + size / self._rate

    def saved(self, size: int, seconds: float) -> None:
        """Learn how long a save has taken: a small one tells what each takes, a large one more."""
        if size < LARGE:
            self._each = seconds
        else:
            self._rate = size / max(seconds - self._each, 0.1 * seconds)
        self._last = time.perf_counter()
