"""What a task hears and tells while it runs: that it was cancelled, and how far it is."""

from __future__ import annotations

import time
from typing import Any, NamedTuple

from bfrt.cluster.worker import running
from bfrt.progress import Progress

#: Seconds between two messages of a task.
BETWEEN = 0.2


class Told(NamedTuple):
    """Tells how far a task is.

    Attributes
    ----------
    task : int
        Its number.
    done, known : int
        Rays of all depths that are finished, and that are known of so far.
    """

    task: int
    done: int
    known: int


class TaskReport:
    """Ends a task that nobody waits for any more, and tells the client how far it is.

    It is called after each pass. Dask cannot stop what runs in a thread; a task that is cancelled
    sees that itself. It asks to be scheduled again, which a task that nobody wants is not, and one
    that is wanted after all is.

    Parameters
    ----------
    topic : str, optional
        Where messages go; by default nobody wants any.
    task : int
        The number of the task.
    """

    def __init__(self, topic: str | None = None, task: int = 0) -> None:
        self._worker = running()
        self._key = None if self._worker is None else self._worker.get_current_task()
        self._topic = topic
        self._task = task
        self._before = self._total = 0
        self._depth = (0, 0)
        self._last = 0.0

    def __call__(self, progress: Progress) -> None:
        if self._worker is None:
            return
        if self._is_cancelled():
            from distributed import Reschedule

            raise Reschedule(f"{self._key} was cancelled")
        if self._topic is not None:
            self._tell(progress)

    def _is_cancelled(self) -> bool:
        task: Any = self._worker.state.tasks.get(self._key)
        return task is None or task.state == "cancelled"

    def _tell(self, progress: Progress) -> None:
        if (progress.band, progress.depth) != self._depth:
            self._depth = (progress.band, progress.depth)
            self._before, self._total = self._before + self._total, 0
        self._total = progress.total
        now = time.monotonic()
        if now - self._last >= BETWEEN:
            self._last = now
            told = Told(self._task, self._before + progress.done, self._before + progress.total)
            self._worker.log_event(self._topic, list(told))
