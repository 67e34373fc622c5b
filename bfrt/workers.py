"""Threads that share a count of things: each takes the next chunk until there is none."""

from __future__ import annotations

import itertools
import os
import threading
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor, wait
from typing import TypeVar

Given = TypeVar("Given")
Made = TypeVar("Made")

#: Called with the worker's number and a chunk [first, last).
Task = Callable[[int, int, int], None]

#: Called with the worker's number; returns whether there may be more to do.
Step = Callable[[int], bool]

#: Chunks a worker gets of a count, at least: what evens out their unequal work.
CHUNKS_EACH = 8


def chunk_of(count: int, threads: int, smallest: int, largest: int) -> int:
    """How many of a count a worker takes at once."""
    return max(smallest, min(largest, -(-count // (threads * CHUNKS_EACH))))


class Workers:
    """`threads` workers. The loops they run release the GIL.

    Chunks are handed out in ascending order, so that each worker reads its files forwards.
    """

    def __init__(self, threads: int) -> None:
        self.threads = threads
        self._pool = ThreadPoolExecutor(threads, "bfrt") if threads > 1 else None

    def run(self, task: Task, count: int, *, smallest: int = 1, largest: int = 8192) -> None:
        """Call `task` for every chunk of range(count); chunks have `smallest` to `largest`.

        Raises
        ------
        BaseException
            The first that a task raised, an interrupt too; no new chunk is begun after it.
        """
        chunk = chunk_of(count, self.threads, smallest, largest)
        starts = itertools.count(0, chunk)

        def step(worker: int) -> bool:
            first = next(starts)
            if first < count:
                task(worker, first, min(count, first + chunk))
            return first < count

        self.repeat(step, alone=count <= chunk)

    def repeat(self, step: Step, *, alone: bool = False) -> None:
        """Have all workers, or one, call `step` again and again until it returns False.

        Raises
        ------
        BaseException
            The first that a step raised, an interrupt too; no new one is begun after it.
        """
        stop = threading.Event()
        failures: list[BaseException] = []

        def work(worker: int) -> None:
            try:
                while not stop.is_set() and step(worker):
                    pass
            except BaseException as error:
                failures.append(error)
                stop.set()

        if self._pool is None or alone:
            work(0)
        else:
            futures = [self._pool.submit(work, worker) for worker in range(self.threads)]
            try:
                wait(futures)
            finally:  # an interrupt finds the workers at work
                stop.set()
                wait(futures)
        if failures:
            raise failures[0]

    def close(self) -> None:
        if self._pool is not None:
            self._pool.shutdown()


#: Results that wait for their turn, beside those that threads are at.
WAITING = 2


def ahead(make: Callable[[Given], Made], given: Iterable[Given], threads: int) -> Iterator[Made]:
    """``map(make, given)``, with `threads` that work ahead; results come in order.

    Raises
    ------
    Exception
        What `make` raised, in its turn; no new work is begun after it.
    """
    with ThreadPoolExecutor(threads, "bfrt-ahead") as pool:
        pending: deque[Future[Made]] = deque()
        try:
            for thing in given:
                pending.append(pool.submit(make, thing))
                if len(pending) >= threads + WAITING:
                    yield pending.popleft().result()
            while pending:
                yield pending.popleft().result()
        finally:
            for future in pending:
                future.cancel()


def usable_threads() -> int:
    """Cores that this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1
