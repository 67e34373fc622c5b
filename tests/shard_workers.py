"""What workers of the tests call, where they can import it, and how their processes end."""

from __future__ import annotations

import os
import signal
import threading
import time
from pathlib import Path

from bfrt.cluster.asked import Asked
from bfrt.cluster.worker import running
from bfrt.conversion import by_workers
from bfrt.wavefront.carriers import ShardPlace
from bfrt.wavefront.tasks import Find, Trace

#: Seconds that a task waits for its end.
LONG = 60.0


def noted_and_ended(note: Path) -> None:
    """Note which process this is, once, and wait to be ended."""
    if not note.exists():
        part = note.with_suffix(".part")
        part.write_text(str(os.getpid()))
        part.rename(note)
        time.sleep(LONG)


def make_shard_at_last(task):
    """Make a shard; who makes number 3 first is ended before."""
    if task.number == 3:
        noted_and_ended(task.writing.target.parent.with_name("note"))
    return by_workers.make_shard(task)


def spilled(path, checksum):
    """Where a task of this worker spills, and the worker's own folder."""
    asked = Asked("160MiB", 1, "sgb", None, None, fresh_marks=False, scratch=None)
    with Trace(ShardPlace(path, checksum, (0,)), asked, None, Find.ANY).tracer() as tracer:
        return str(tracer.scratch), str(running().local_directory)


class Killer(threading.Thread):
    """Ends the process that a file names, as soon as it is there."""

    def __init__(self, note: Path) -> None:
        super().__init__()
        self.killed = 0
        self._note = note

    def run(self) -> None:
        end = time.monotonic() + LONG / 2
        while not self.killed and time.monotonic() < end:
            time.sleep(0.05)
            if self._note.exists():
                self.killed = int(self._note.read_text())
                os.kill(self.killed, signal.SIGKILL)
