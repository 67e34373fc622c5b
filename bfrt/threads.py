"""Threads that all run before any work is given to them.

A pool of Python's own starts a thread when there is work for it. Where the system refuses the
thread the work stays where it is, and whoever waits for it waits for ever.
"""

from __future__ import annotations

import _thread
import atexit
import os
import sys
import threading
from collections.abc import Callable
from concurrent.futures import Future
from queue import Empty, SimpleQueue
from typing import Any, Generic, TypeVar
from weakref import WeakSet

from bfrt.errors import ResourceError
from bfrt.thread_body import serve

Made = TypeVar("Made")

#: All pools that somebody refers to.
_POOLS: WeakSet[Pool] = WeakSet()

#: Held here, for modules are emptied when the interpreter ends.
_ending = sys.is_finalizing


class Call(Generic[Made]):
    """Calls something once, and has its result or its exception told by a future."""

    def __init__(self, call: Callable[..., Made], given: tuple[Any, ...]) -> None:
        self.future: Future[Made] = Future()
        self._call = call
        self._given = given

    def __call__(self) -> None:
        if not self.future.set_running_or_notify_cancel():
            return
        try:
            made = self._call(*self._given)
        except BaseException as error:
            self.future.set_exception(error)
        else:
            self.future.set_result(made)


class Pool:
    """Runs calls on threads, in the order they come; they end with the interpreter at the latest.

    Parameters
    ----------
    threads : int
        Number of threads, which are started at once.
    name : str
        What the system calls them.

    Raises
    ------
    ResourceError
        If the system refuses one of them.
    """

    def __init__(self, threads: int, name: str) -> None:
        self._calls: SimpleQueue[Callable[[], object] | None] = SimpleQueue()
        self._told: SimpleQueue[BaseException | None] = SimpleQueue()
        self._running = 0
        self._process = os.getpid()
        _POOLS.add(self)
        try:
            for _ in range(threads):
                given = (name.encode(), self._calls, self._told, _begin)
                _thread.start_new_thread(serve, given)
                if refusal := self._told.get():
                    raise refusal
                self._running += 1
        except (RuntimeError, MemoryError) as error:
            number = self._running + 1
            self.close()
            raise ResourceError(
                f"threads: found no room for thread {number} of {threads} ({name}), expected the "
                "system to have it (see ulimit -v, ulimit -u)"
            ) from error
        except BaseException:  # an interrupt
            self.close()
            raise

    def submit(self, call: Callable[..., Made], *given: Any) -> Future[Made]:
        """Have a thread call something; return what will tell the result.

        A pool without threads, as one that is closed, calls it at once.
        """
        made = Call(call, given)
        if self._running:
            self._calls.put(made)
        else:
            made()
        return made.future

    def cancel(self) -> None:
        """Cancel the calls that are not begun."""
        while True:
            try:
                call = self._calls.get_nowait()
            except Empty:
                return
            if isinstance(call, Call):
                call.future.cancel()

    def close(self) -> None:
        """End the threads, when they have done all calls. May be repeated."""
        running, self._running = self._running, 0
        # A child of the process has no threads; where the interpreter ends none runs any more.
        if os.getpid() != self._process or _ending():
            return
        for _ in range(running):
            self._calls.put(None)
        for _ in range(running):
            self._told.get()

    def __enter__(self) -> Pool:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def __del__(self) -> None:
        for _ in range(getattr(self, "_running", 0)):
            self._calls.put(None)


def _close_all() -> None:
    """End all threads while they can still run."""
    for pool in list(_POOLS):
        pool.close()


atexit.register(_close_all)


class Threads:
    """Runs calls on threads that are started when the first call comes, and again after a fork."""

    def __init__(self, threads: int, name: str) -> None:
        self._threads = threads
        self._name = name
        self._forget()
        if hasattr(os, "register_at_fork"):
            os.register_at_fork(after_in_child=self._forget)

    def _forget(self) -> None:
        """Forget the threads, which a child of the process has not."""
        self._pool: Pool | None = None
        self._starting = threading.Lock()

    def submit(self, call: Callable[..., Made], *given: Any) -> Future[Made]:
        """Have a thread call something.

        Raises
        ------
        ResourceError
            If the system refuses the threads.
        """
        with self._starting:
            if self._pool is None:
                self._pool = Pool(self._threads, self._name)
            return self._pool.submit(call, *given)


def _begin() -> None:
    """Need a stack."""
