"""The worker that this process is: its name, its threads, and the memory that it may take."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable
from typing import Any, NamedTuple

from bfrt.memory import MOST, cgroup_limits, default_memory
from bfrt.workers import usable_threads


class Worker(NamedTuple):
    """Describes a worker.

    Attributes
    ----------
    name : str
        What errors call it.
    threads : int
        Threads that a task may use: all of the worker's, as one task of a process traces at a time.
    default : int
        The memory budget where none is asked for, bytes: a quarter of what the worker has.
    most : int
        The most that a budget may be, bytes: where Dask pauses the worker, or its cgroup ends it.
    """

    name: str
    threads: int
    default: int
    most: int


def this_worker() -> Worker:
    """Return the worker that runs the current task; one of Dask's local schedulers is a process."""
    own = running()
    if own is None:
        return Worker(f"process {os.getpid()}", usable_threads(), default_memory(), MOST)
    manager = own.memory_manager
    limit, pause = manager.memory_limit, manager.memory_pause_fraction
    default, most = default_memory(), min([MOST, *cgroup_limits()])
    if limit:
        default = min(default, limit // 4)
        most = min(most, int(limit * (pause or 1.0)))
    return Worker(f"worker {own.name} ({own.address})", own.state.nthreads, default, most)


def running() -> Any:
    """Return Dask's worker that runs the current task, or None."""
    module = sys.modules.get("distributed.worker")
    if module is None:
        return None
    try:
        return module.get_worker()
    except ValueError:
        return None


#: The plugin of a worker that ends what we keep there.
PLUGIN = "bfrt"


def at_end_of_worker(close: Callable[[], None]) -> None:
    """Have something called when the worker that runs the current task ends: once for each."""
    own = running()
    if own is None or PLUGIN in own.plugins:
        return
    from distributed import WorkerPlugin

    class Closing(WorkerPlugin):  # type: ignore[misc]  # untyped
        def teardown(self, worker: Any) -> None:
            close()

    own.loop.add_callback(own.plugin_add, Closing(), PLUGIN)
