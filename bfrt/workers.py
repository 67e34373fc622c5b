"""Threads that share a count of things: each takes the next chunk until there is none."""

from __future__ import annotations

import itertools
import os
from collections import deque
from collections.abc import Callable, Generator, Iterable
from concurrent.futures import Future, wait
from typing import Protocol, TypeVar

from bfrt.threads import Pool

Given = TypeVar("Given")
Made = TypeVar("Made")

#: Called with the worker's number and a chunk [first, last).
Task = Callable[[int, int, int], None]

Chunk = TypeVar("Chunk", covariant=True)


class Source(Protocol[Chunk]):
    """Hands out work.

    Attributes
    ----------
    short : bool
        Whether one worker is enough for all of it.
    """

    @property
    def short(self) -> bool: ...

    def next(self, worker: int, /) -> Chunk | None:
        """Give a worker its next chunk, or None when there are no more."""
        ...


class Stop:
    """Tells workers to begin nothing more.

    Attributes
    ----------
    requested : bool
        Whether they shall stop.
    """

    requested = False


#: Called with the worker's number, and what tells it to stop.
Loop = Callable[[int, Stop], None]

#: Chunks a worker gets of a count, at least: what evens out their unequal work.
CHUNKS_EACH = 8


#: Candidates whose work is worth handing to a thread: it takes as long as to hand them out.
WORTH = 4096


def worth_handing(count: int, candidates: int) -> int:
    """Return how many of `count` things are worth handing out, which share so many candidates."""
    return 1 + WORTH * count // max(1, candidates)


def chunk_of(count: int, threads: int, smallest: int, largest: int) -> int:
    """Return how many of a count a worker takes at once."""
    return max(smallest, min(largest, -(-count // (threads * CHUNKS_EACH))))


class Workers:
    """Runs loops that release the GIL on `threads` threads.

    Chunks are handed out in ascending order, so that each worker reads its files forwards.
    """

    def __init__(self, threads: int) -> None:
        self.threads = threads
        self._pool = Pool(threads - 1, "bfrt") if threads > 1 else None

    def run(self, task: Task, count: int, *, smallest: int = 1, largest: int = 8192) -> None:
        """Call `task` for every chunk of range(count); chunks have `smallest` to `largest`.

        Raises
        ------
        BaseException
            The first that a task raised, an interrupt too; no new chunk is begun after it.
        """
        chunk = chunk_of(count, self.threads, smallest, largest)
        starts = itertools.count(0, chunk)

        def count_down(worker: int, stop: Stop) -> None:
            while not stop.requested and (first := next(starts)) < count:
                task(worker, first, min(count, first + chunk))

        self._share(count_down, alone=count <= chunk)

    def drain(
        self,
        source: Source[Made],
        work: Callable[[int, Made], object],
        finish: Callable[[int], object] | None = None,
    ) -> None:
        """Call `work` for every chunk of a source, with the number of the worker that has it.

        Each worker ends with `finish`, once it gets no more; one that comes too late for any chunk
        may not be heard of at all.

        Raises
        ------
        BaseException
            The first that came up, an interrupt too; no new chunk is begun after it.
        """

        def empty(worker: int, stop: Stop) -> None:
            while not stop.requested and (chunk := source.next(worker)) is not None:
                work(worker, chunk)
            if finish is not None and not stop.requested:
                finish(worker)

        self._share(empty, alone=source.short)

    def _share(self, loop: Loop, *, alone: bool) -> None:
        """Run a loop, which ends when it is told to stop, on all workers or on one.

        The caller is the first worker. To wake a thread takes longer than many a loop: whichever
        has not begun when the caller comes to the end finds nothing left, and is not waited for.
        """
        stop = Stop()
        failures: list[BaseException] = []

        def run(worker: int) -> None:
            try:
                loop(worker, stop)
            except BaseException as error:
                failures.append(error)
                stop.requested = True

        others: list[Future[None]] = []
        try:
            if self._pool is not None and not alone:
                others = [self._pool.submit(run, worker) for worker in range(1, self.threads)]
            run(0)
            others = [other for other in others if not other.cancel()]
            if others:
                wait(others)
        finally:  # an interrupt finds the workers at work
            stop.requested = True
            wait(others)
        if failures:
            raise failures[0]

    def close(self) -> None:
        if self._pool is not None:
            self._pool.close()


#: Results that wait for their turn, beside those that threads are at, unless memory has fewer.
WAITING = 2


def ahead(
    make: Callable[[Given], Made], given: Iterable[Given], threads: int, waiting: int = WAITING
) -> Generator[Made, None, None]:
    """Yield ``map(make, given)`` in order, with `threads` threads that work ahead.

    No more than `threads` and `waiting` things, given or made, are held here at once, and one that
    was yielded is not; so with one thread and none that waits the next is asked for when the last
    was yielded.

    Raises
    ------
    ResourceError
        If the system refuses a thread.
    Exception
        The exception that `make` raised, in its turn; no new work is begun after it.
    """
    with Pool(threads, "bfrt-ahead") as pool:
        pending: deque[Future[Made]] = deque()
        try:
            for thing in given:
                pending.append(pool.submit(make, thing))
                del thing  # which may be large
                if len(pending) >= threads + waiting:
                    yield pending.popleft().result()
            while pending:
                yield pending.popleft().result()
        finally:
            for future in pending:
                future.cancel()


def usable_threads() -> int:
    """Return the number of cores that this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1
