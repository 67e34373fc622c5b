"""A client that waits for its tasks: it hears how far they are, and cancels what it leaves."""

from __future__ import annotations

import logging
import uuid
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from queue import Empty, SimpleQueue
from types import TracebackType
from typing import Any

from bfrt.cluster.engine import in_our_words
from bfrt.cluster.outcome import Failed, Quiet
from bfrt.cluster.reports import Told
from bfrt.progress import Progress, Report, tell

log = logging.getLogger(__name__)

#: Seconds after which a client that hears nothing looks at its tasks.
PATIENCE = 1.0


@dataclass(eq=False)
class Errand:
    """Holds a task that workers are to do.

    Attributes
    ----------
    key : str
    task : callable
    given : object
        What it is called with.
    workers : tuple of str
        Addresses of those that had best do it; none where that is all the same.
    future : distributed.Future
    """

    key: str
    task: Quiet
    given: Any
    workers: tuple[str, ...]
    future: Any


class Watch:
    """Waits for tasks, and reports how far all of them are together.

    As a context it cancels, as it is left, the tasks that are not through: by an error, an
    interrupt, or a report that returns False. What Dask says of a client or of workers that end
    leaves it in our words.

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
        self._errands: dict[str, Errand] = {}  # that are not through, by their futures' keys

    def __enter__(self) -> Watch:
        if not self._client.nthreads():
            log.warning("the cluster has no worker: waiting until there is one")
        if self.topic is not None:
            self._client.subscribe_topic(self.topic, lambda event: self._heard.put(event[1]))
        return self

    def __exit__(
        self, _: type[BaseException] | None, error: BaseException | None, __: TracebackType | None
    ) -> None:
        try:
            self._leave()
        except Exception as closed:
            if error is None or in_our_words(closed) is None:
                raise
        ours = in_our_words(error)
        if ours is not None:
            raise ours from error

    def _leave(self) -> None:
        futures, self._errands = [errand.future for errand in self._errands.values()], {}
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
    ) -> list[Errand]:
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
        list of Errand
        """
        keys = [f"bfrt-{what}-{self._name}-{number}" for number in range(len(given))]
        quiet, near = Quiet(task), tuple(workers or ())
        futures = self._send(quiet, given, keys, near)
        errands = [
            Errand(key, quiet, each, near, future)
            for key, each, future in zip(keys, given, futures, strict=True)
        ]
        self._errands.update(zip(keys, errands, strict=True))
        self._listen(futures)
        self._tasks = len(given)
        return errands

    def _send(
        self, task: Quiet, given: Sequence[Any], keys: list[str], workers: tuple[str, ...]
    ) -> list[Any]:
        near: dict[str, Any] = (
            {"workers": list(workers), "allow_other_workers": True} if workers else {}
        )
        futures: list[Any] = self._client.map(task, given, key=keys, pure=False, **near)
        return futures

    def _listen(self, futures: list[Any]) -> None:
        for future in futures:
            future.add_done_callback(self._heard.put)

    def _next(self) -> Any:
        """Wait for a message or a future that is done; return None where none comes for a while."""
        try:
            return self._heard.get(timeout=PATIENCE)
        except Empty:
            if self._client.status == "running":
                self._begin_again()
            return None

    def _begin_again(self) -> None:
        """Begin the tasks anew that wait for workers which have all ended.

        Dask gives such a task to others, but not where there was none at that time: it waits on
        when others have come.
        """
        near = [errand for errand in self._errands.values() if errand.workers]
        there = self._client.nthreads() if near else {}
        if not there:
            return
        lost = [errand for errand in near if not there.keys() & errand.workers]
        begun = {key for keys in self._client.processing().values() for key in keys} if lost else {}
        for errand in lost:
            old = errand.future
            if old.key in begun or old.done():
                continue
            key = f"{errand.key}-again"
            (errand.future,) = self._send(errand.task, [errand.given], [key], ())
            errand.workers = ()
            self._errands[key] = self._errands.pop(old.key)
            self._client.cancel([old])
            self._listen([errand.future])

    def first(self) -> Errand:
        """Wait for the first of all tasks that is done and not through yet.

        Returns
        -------
        Errand
            Its `result` is there.
        """
        while True:
            heard = self._next()
            if heard is None:
                done = [each for each in self._errands.values() if each.future.done()]
                if done:
                    return done[0]
            elif isinstance(heard, (list, tuple)):
                self._hear(heard)
            elif heard.key in self._errands:
                return self._errands[heard.key]

    def result(self, errand: Errand) -> Any:
        """Wait for a task, and return what it gives back, which the workers then forget.

        Raises
        ------
        BaseException
            The first that any task raised, before or after this one.
        Cancelled
            If the report returns False.
        """
        while not errand.future.done():
            heard = self._next()
            if heard is not None:
                self._hear(heard)
        future = errand.future
        result = future.result()
        del self._errands[future.key]
        future.release()
        if isinstance(result, Failed):
            raise result.again()
        return result

    def _hear(self, heard: Any) -> None:
        """Take a message of a task, or a future that is done."""
        if not isinstance(heard, (list, tuple)):
            if heard.key in self._errands and is_bad(heard):
                self.result(self._errands[heard.key])
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


def is_bad(future: Any) -> bool:
    """Tell whether a task that is done has raised something, before its result is fetched."""
    return future.status != "finished" or future.type is Failed
