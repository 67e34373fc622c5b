"""A client that waits for its tasks: it hears how far they are, and cancels what it leaves."""

from __future__ import annotations

import uuid
from collections.abc import Callable, Sequence
from queue import Empty, SimpleQueue
from typing import Any

from bfrt.cluster.reports import Told
from bfrt.progress import Progress, Report, tell

#: Seconds after which a client that hears nothing looks at its tasks.
PATIENCE = 1.0


class Watch:
    """Waits for tasks, and reports how far all of them are together.

    As a context it cancels, as it is left, the tasks that are not through: by an error, an
    interrupt, or a report that returns False.

    Parameters
    ----------
    client : distributed.Client
    rays : int
        Rays of the first depth of all tasks.
    report : Report, optional
        Called in the thread that waits.

    Attributes
    ----------
    topic : str, optional
        What tasks are to send their messages under; None where nobody wants any.
    """

    def __init__(self, client: Any, rays: int, report: Report | None) -> None:
        self._client = client
        self._rays = rays
        self._report = report
        self._name = uuid.uuid4().hex
        self.topic = None if report is None else f"bfrt-{self._name}"
        self._heard: SimpleQueue[Any] = SimpleQueue()
        self._tasks = 0
        self._through: set[int] = set()
        self._far: dict[int, Told] = {}
        self._done = 0
        self._futures: dict[str, Any] = {}  # that are not through, by their keys

    def __enter__(self) -> Watch:
        if self.topic is not None:
            self._client.subscribe_topic(self.topic, lambda event: self._heard.put(event[1]))
        return self

    def __exit__(self, *_: object) -> None:
        futures, self._futures = list(self._futures.values()), {}
        try:
            if futures:
                self._client.cancel(futures)
        finally:
            if self.topic is not None:
                self._client.unsubscribe_topic(self.topic)

    def begin(
        self,
        task: Callable[..., Any],
        given: Sequence[Any],
        what: str,
        workers: Sequence[str] | None = None,
    ) -> list[Any]:
        """Have workers call `task` for each of what is given, the first ones first.

        Parameters
        ----------
        task : callable
        given : sequence
        what : str
            What keys are made of: another for each call.
        workers : sequence of str, optional
            Addresses of those that had best do it: others do where these have ended.

        Returns
        -------
        list of distributed.Future
        """
        keys = [f"bfrt-{what}-{self._name}-{number}" for number in range(len(given))]
        futures: list[Any] = self._client.map(
            task, given, key=keys, pure=False, workers=workers,
            allow_other_workers=workers is not None,
        )  # fmt: skip
        self._futures.update(zip(keys, futures, strict=True))
        for future in futures:
            future.add_done_callback(self._heard.put)
        self._tasks = len(given)
        return futures

    def first(self) -> Any:
        """Wait for the first of all tasks that is done and not through yet.

        Returns
        -------
        distributed.Future
            Its `result` is there.
        """
        while True:
            try:
                heard = self._heard.get(timeout=PATIENCE)
            except Empty:
                done = [future for future in self._futures.values() if future.done()]
                if done:
                    return done[0]
                continue
            if isinstance(heard, (list, tuple)):
                self._hear(heard)
            elif heard.key in self._futures:
                return heard

    def result(self, future: Any) -> Any:
        """Wait for a task, and return what it gives back, which the workers then forget.

        Raises
        ------
        BaseException
            The first that any task raised, before or after this one.
        Cancelled
            If the report returns False.
        """
        while not future.done():
            try:
                self._hear(self._heard.get(timeout=PATIENCE))
            except Empty:
                continue
        result = future.result()
        del self._futures[future.key]
        future.release()
        return result

    def _hear(self, heard: Any) -> None:
        """Take a message of a task, or a future that is done."""
        if not isinstance(heard, (list, tuple)):
            if heard.key in self._futures and heard.status != "finished":
                heard.result()
            return
        told = Told(*heard)
        if told.task not in self._through:  # messages may come after the result
            self._far[told.task] = told
            self._tell_all()

    def through(self, task: int, rays: int) -> None:
        """Count a task as through, which has traced so many rays in all."""
        self._through.add(task)
        self._far[task] = Told(task, rays, rays)
        self._tell_all()

    def _tell_all(self) -> None:
        if self._report is None:
            return
        # A task that another worker begins again is less far than it was; the sum does not fall.
        self._done = max(self._done, sum(told.done for told in self._far.values()))
        known = sum(told.known for told in self._far.values())
        known += self._rays * (self._tasks - len(self._far)) // max(1, self._tasks)  # not begun
        known = max(known, self._done)
        tell(self._report, Progress(1, self._done, known))
