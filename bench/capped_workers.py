"""Workers of a Dask cluster on this machine, each in a memory cgroup of its own."""

from __future__ import annotations

import contextlib
import os
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

from capped import inside, memory_cap

#: What has workers tell warnings alone.
QUIET = {"DASK_LOGGING__DISTRIBUTED": "warning"}


class Workers(NamedTuple):
    """A client of workers, and the cgroup of each; None where none can be made."""

    client: Any
    groups: list[Path | None]


@contextlib.contextmanager
def capped_workers(
    count: int, amount: int, folder: Path, *, replaced: bool = False
) -> Iterator[Workers]:
    """So many workers of one thread, in cgroups of `amount` bytes.

    Parameters
    ----------
    folder : Path
        Where their files are.
    replaced : bool
        Whether one that ends is replaced, in the same cgroup: that has a process more then.
    """
    from distributed import Client, LocalCluster

    with contextlib.ExitStack() as stack:
        cluster = stack.enter_context(LocalCluster(n_workers=0, dashboard_address=":0"))
        groups = []
        for number in range(count):
            group = stack.enter_context(memory_cap(amount, f"-{number}"))
            command = [
                *(sys.executable, "-m", "distributed.cli.dask_worker", cluster.scheduler_address),
                *("--nthreads", "1", "--memory-limit", str(amount), "--no-dashboard"),
                *("--nanny" if replaced else "--no-nanny", "--name", str(number)),
                *("--local-directory", str(folder)),
            ]
            command = inside(group, command) if group else command
            started = subprocess.Popen(command, cwd=folder, env={**os.environ, **QUIET})
            stack.callback(started.wait)
            stack.callback(started.terminate)
            groups.append(group)
        client = stack.enter_context(Client(cluster))
        client.wait_for_workers(count, timeout=60)
        yield Workers(client, groups)
