"""Tasks under way: no more for each carrier than keep it at work, taken as they are done."""

from __future__ import annotations

from typing import Any, NamedTuple

from bfrt.cluster.watching import Watch
from bfrt.wavefront.carriers import Carrier

#: Tasks under way for each carrier: one is done while another travels.
AHEAD = 2


class Done(NamedTuple):
    """Holds what a task has returned, and what its sender noted."""

    carrier: int
    note: Any
    result: Any


class Window:
    """Sends tasks to carriers, and returns what they return, whichever is done first.

    Parameters
    ----------
    watch : Watch
    carriers : list of Carrier
    """

    def __init__(self, watch: Watch, carriers: list[Carrier]) -> None:
        self._watch = watch
        self._carriers = carriers
        self._under_way: dict[str, tuple[int, Any]] = {}
        self._each = [0] * len(carriers)
        self._sent = 0

    @property
    def busy(self) -> bool:
        """Tell whether any task is under way."""
        return bool(self._under_way)

    def under_way(self, carrier: int) -> int:
        """Return the number of tasks that a carrier has."""
        return self._each[carrier]

    def send(self, carrier: int, task: Any, given: Any, note: Any = None) -> None:
        """Have a carrier's worker call a task; another does where that has ended."""
        self._sent += 1
        workers = list(self._carriers[carrier].workers)
        (errand,) = self._watch.begin(task, [given], f"leg-{self._sent}", workers)
        self._under_way[errand.key] = carrier, note
        self._each[carrier] += 1

    def take(self) -> Done:
        """Wait for the first task that is done; raise what it raised."""
        errand = self._watch.first()
        carrier, note = self._under_way.pop(errand.key)
        self._each[carrier] -= 1
        return Done(carrier, note, self._watch.result(errand))
