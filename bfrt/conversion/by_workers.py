"""The shards of a scene, each made by one worker of a cluster, which reads its files itself.

Names and settings go to the workers, and what each shard used comes back; files and stores are
where all machines see them.
"""

from __future__ import annotations

import threading
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from bfrt.cluster.reports import TaskReport
from bfrt.cluster.watching import Watch
from bfrt.cluster.worker import Worker, this_worker
from bfrt.conversion.sharding import Made, Make, ShardTask
from bfrt.conversion.sources import SceneFile, SceneSource, sources_of
from bfrt.conversion.writing import bytes_of
from bfrt.errors import BudgetError, SceneError, StoreError
from bfrt.memory import format_memory
from bfrt.paths import without_links
from bfrt.progress import Done, DoneReport, Progress, staged

#: A budget is a process's: its tasks convert one after another.
_CONVERTING = threading.Lock()


def by_workers(client: Any, sources: Sequence[SceneSource], report: DoneReport | None) -> Make:
    """Return what has workers make shards, as many at once as there are workers.

    Parameters
    ----------
    client : distributed.Client
    sources : sequence of SceneSource
        All of the scene's.
    report : callable, optional
        Gets the bytes of the files whose shards are complete.
    """

    def make(tasks: Sequence[ShardTask]) -> Iterator[Made]:
        read = staged(report, "reading", bytes_of(sources) or None)
        done = bytes_of(sources) - sum(map(bytes_of_task, tasks))
        with Watch(client, 0, None) as watch:
            made = watch.begin(make_shard, [for_workers(task) for task in tasks], "shard")
            for task, errand in zip(tasks, made, strict=True):
                yield watch.result(errand)
                done += bytes_of_task(task)
                if read is not None:
                    read(done)

    return make


def bytes_of_task(task: ShardTask) -> int:
    """Return the bytes of the files that become a shard."""
    return bytes_of(sources_of(task.sources))


def for_workers(task: ShardTask) -> ShardTask:
    """Return a task whose paths are the same wherever a worker runs."""
    names = tuple(
        str(without_links(each.name)) if isinstance(each, SceneFile) else each.name
        for each in sources_of(task.sources)
    )
    target = without_links(task.writing.target)
    return replace(task, sources=names, writing=task.writing._replace(target=target))


def make_shard(task: ShardTask) -> Made:
    """Make a shard, as a task of a worker.

    Raises
    ------
    BudgetError
        If the budget is more than the worker may take.
    StoreError, SceneError
        As `bfrt.convert`, with the worker's name.
    """
    worker = this_worker()
    memory = budget_of(task, worker)
    with _CONVERTING:
        if not Path(task.writing.target).parent.is_dir():
            raise StoreError(
                f"{worker.name}: {task.writing.target}: found no folder for it, expected the one "
                "that the client has made: all machines need to see it"
            )
        try:
            return replace(task, memory=memory).run(Ending())
        except SceneError as error:
            raise SceneError(f"{worker.name}: {error}") from None


def budget_of(task: ShardTask, worker: Worker) -> int:
    """Return the memory budget of a task on a worker."""
    memory = worker.default if task.memory is None else task.memory
    if memory > worker.most:
        raise BudgetError(
            f"memory: found {format_memory(memory)}, expected {worker.most >> 20}MiB or less: "
            f"{worker.name} is paused or ended beyond that"
        )
    return memory


class Ending:
    """Ends a conversion that nobody waits for any more, as it tells how far it is."""

    def __init__(self) -> None:
        self._report = TaskReport()

    def __call__(self, done: Done) -> bool:
        self._report(Progress(1, int(done), done.total or int(done)))
        return True
